// A robot of Cyclone DDS in C: peer OUT IN; see peers.py.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <dds/dds.h>
#include "messages.h"

#define WRENCHES 5000
#define EVERY 100  // wrenches a cloud
#define BYTES 120000

typedef geometry_msgs_msg_dds__WrenchStamped_ Wrench;
typedef sensor_msgs_msg_dds__PointCloud2_ Cloud;

static dds_entity_t participant;
static dds_time_t heard_at;

static dds_entity_t end_of(const dds_topic_descriptor_t *type, const char *name,
                           const char *suffix, bool writes, bool reliable) {
    char topic[200];
    snprintf(topic, sizeof topic, "rt%s%s", name, suffix);
    dds_qos_t *qos = dds_create_qos();
    dds_qset_reliability(
        qos, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1000);
    dds_entity_t of = dds_create_topic(participant, type, topic, NULL, NULL);
    dds_entity_t end = writes ? dds_create_writer(participant, of, qos, NULL)
                              : dds_create_reader(participant, of, qos, NULL);
    if (end < 0) {
        fprintf(stderr, "%s: %s\n", topic, dds_strretcode(-end));
        exit(1);
    }
    dds_delete_qos(qos);
    return end;
}

// Prints the numbers of what has come.
static void hear(dds_entity_t reader, bool is_cloud) {
    void *sample[1] = {NULL};
    dds_sample_info_t info;
    while (dds_take(reader, sample, &info, 1, 1) > 0) {
        if (info.valid_data) {
            heard_at = dds_time();
            if (is_cloud)
                printf("cloud %u %u\n", ((Cloud *)sample[0])->row_step,
                       ((Cloud *)sample[0])->data._length);
            else
                printf("wrench %.0f\n", 1e9 * ((Wrench *)sample[0])->wrench.force.x);
        }
        dds_return_loan(reader, sample, 1);
    }
}

int main(int count, char **words) {
    if (count != 3) return 2;
    participant = dds_create_participant(atoi(getenv("ROS_DOMAIN_ID")), NULL, NULL);
    const dds_topic_descriptor_t *wrench_type = &geometry_msgs_msg_dds__WrenchStamped__desc;
    const dds_topic_descriptor_t *cloud_type = &sensor_msgs_msg_dds__PointCloud2__desc;
    dds_entity_t wrenches = end_of(wrench_type, words[1], "", true, true);
    dds_entity_t fleeting = end_of(wrench_type, words[1], "_best_effort", true, false);
    dds_entity_t clouds = end_of(cloud_type, words[1], "_cloud", true, true);
    dds_entity_t in_wrenches = end_of(wrench_type, words[2], "", false, true);
    dds_entity_t in_clouds = end_of(cloud_type, words[2], "_cloud", false, true);
    dds_publication_matched_status_t out;
    dds_subscription_matched_status_t in;
    do {
        dds_sleepfor(DDS_MSECS(50));
        dds_get_publication_matched_status(wrenches, &out);
        dds_get_subscription_matched_status(in_wrenches, &in);
    } while (!out.current_count || !in.current_count);
    dds_sleepfor(DDS_SECS(1));
    Wrench wrench = {.header.frame_id = "probe", .wrench = {.force.z = -5.0, .torque.y = 0.1}};
    Cloud cloud = {.header.frame_id = "probe", .height = 1, .width = BYTES, .point_step = 1};
    cloud.data._buffer = calloc(BYTES, 1);
    cloud.data._length = cloud.data._maximum = BYTES;
    dds_time_t began = heard_at = dds_time();
    for (int i = 0; i < WRENCHES; i++) {
        while (dds_time() < began + DDS_MSECS(i)) {
            hear(in_wrenches, false);
            hear(in_clouds, true);
            dds_sleepfor(DDS_USECS(200));
        }
        dds_time_t now = dds_time();
        wrench.header.stamp.sec = (int32_t)(now / DDS_NSECS_IN_SEC);
        wrench.header.stamp.nanosec = (uint32_t)(now % DDS_NSECS_IN_SEC);
        wrench.wrench.force.x = 1e-9 * i;
        cloud.row_step = i / EVERY;
        if (dds_write(wrenches, &wrench) || dds_write(fleeting, &wrench) ||
            (i % EVERY == 0 && dds_write(clouds, &cloud))) {
            fprintf(stderr, "wrench %d or its cloud can't be sent\n", i);
            return 1;
        }
    }
    while (dds_time() < heard_at + DDS_SECS(2)) {
        hear(in_wrenches, false);
        hear(in_clouds, true);
        dds_sleepfor(DDS_MSECS(1));
    }
    dds_delete(participant);
    return 0;
}
