// A robot of Fast DDS in C++: peer OUT IN; see peers.py.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include "messagesPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using Wrench = geometry_msgs::msg::dds_::WrenchStamped_;
using Cloud = sensor_msgs::msg::dds_::PointCloud2_;

constexpr int WRENCHES = 5000, EVERY = 100, BYTES = 120000;
Clock::time_point heard_at;

template <typename Qos> Qos quality(bool reliable) {
    Qos qos;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 1000;
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    return qos;
}

// Prints the numbers of what has come.
template <typename Message, typename Print> void hear(DataReader *reader, Print print) {
    Message message;
    SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data) {
            heard_at = Clock::now();
            print(message);
        }
}

int main(int count, char **words) {
    if (count != 3) return 2;
    DomainParticipantQos qos;  // without memory that is shared: the one of another version differs
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(
        std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
    // keeps to this machine, as ROS does with range LOCALHOST
    eprosima::fastrtps::rtps::Locator_t here;
    eprosima::fastrtps::rtps::IPLocator::setIPv4(here, 127, 0, 0, 1);
    qos.wire_protocol().builtin.initialPeersList.push_back(here);
    auto *participant = DomainParticipantFactory::get_instance()->create_participant(
        std::atoi(std::getenv("ROS_DOMAIN_ID")), qos);
    TypeSupport wrench_type(new geometry_msgs::msg::dds_::WrenchStamped_PubSubType);
    TypeSupport cloud_type(new sensor_msgs::msg::dds_::PointCloud2_PubSubType);
    wrench_type.register_type(participant);
    cloud_type.register_type(participant);
    auto topic = [&](const char *name, const char *suffix, TypeSupport &type) {
        auto whole = std::string("rt") + name + suffix;
        return participant->create_topic(whole, type.get_type_name(), TOPIC_QOS_DEFAULT);
    };
    auto *publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto *subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    auto reliable = quality<DataWriterQos>(true);
    auto *wrenches = publisher->create_datawriter(topic(words[1], "", wrench_type), reliable);
    auto *fleeting = publisher->create_datawriter(
        topic(words[1], "_best_effort", wrench_type), quality<DataWriterQos>(false));
    reliable.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;  // what is over 64 kB needs it
    auto *clouds = publisher->create_datawriter(topic(words[1], "_cloud", cloud_type), reliable);
    auto asked = quality<DataReaderQos>(true);
    auto *in_wrenches = subscriber->create_datareader(topic(words[2], "", wrench_type), asked);
    auto *in_clouds = subscriber->create_datareader(topic(words[2], "_cloud", cloud_type), asked);
    auto hear_all = [&] {
        hear<Wrench>(in_wrenches, [](Wrench &wrench) {
            std::printf("wrench %.0f\n", 1e9 * wrench.wrench().force().x());
        });
        hear<Cloud>(in_clouds, [](Cloud &cloud) {
            std::printf("cloud %u %zu\n", cloud.row_step(), cloud.data().size());
        });
    };
    PublicationMatchedStatus out;
    SubscriptionMatchedStatus in;
    do {
        std::this_thread::sleep_for(50ms);
        wrenches->get_publication_matched_status(out);
        in_wrenches->get_subscription_matched_status(in);
    } while (!out.current_count || !in.current_count);
    std::this_thread::sleep_for(1s);
    Wrench wrench;
    wrench.header().frame_id("probe");
    wrench.wrench().force().z(-5.0);
    wrench.wrench().torque().y(0.1);
    Cloud cloud;
    cloud.header().frame_id("probe");
    cloud.height(1);
    cloud.width(BYTES);
    cloud.point_step(1);
    cloud.data().resize(BYTES);
    auto began = heard_at = Clock::now();
    for (int i = 0; i < WRENCHES; i++) {
        while (Clock::now() < began + i * 1ms) {
            hear_all();
            std::this_thread::sleep_for(200us);
        }
        auto now = std::chrono::system_clock::now().time_since_epoch() / 1ns;
        wrench.header().stamp().sec(now / 1000000000);
        wrench.header().stamp().nanosec(now % 1000000000);
        wrench.wrench().force().x(1e-9 * i);
        cloud.row_step(i / EVERY);
        if (!wrenches->write(&wrench) || !fleeting->write(&wrench) ||
            (i % EVERY == 0 && !clouds->write(&cloud))) {
            std::fprintf(stderr, "wrench %d or its cloud can't be sent\n", i);
            return 1;
        }
    }
    while (Clock::now() < heard_at + 2s) {
        hear_all();
        std::this_thread::sleep_for(1ms);
    }
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
}
