// PCL at the work of the benchmark: a server that answers every line with one line.
//
//   load PATH            float32 records (x, y, z, weight) [m]      -> ok POINTS
//   run NAME             condense or fresh: how many clusters; fuse: how many voxels
//                                                                  -> ok NANOSECONDS COUNT
//   labels PATH          after condense: one int32 a point          -> ok POINTS
//
// Times are the CPU time of this thread. Any failure answers "error ...".
//
// PCL's own binaries are built for plain x86-64: instantiating its templates here lets -march=native
// reach them, and keeps Eigen's alignment, which -march=native changes, the same on both sides.
#define PCL_NO_PRECOMPILE

#include <cstdint>
#include <ctime>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <pcl/filters/voxel_grid.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

namespace {

using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using KdTree = pcl::search::KdTree<Point>;

constexpr float kVoxelSize = 0.005F;
// Squared offsets of voxels are whole: 2.1 sides takes 4 and leaves 5, whatever float32 rounds.
constexpr double kVoxelTolerance = 2.1 * 0.005;
constexpr double kPointTolerance = 2.0 * 0.005;

struct Centroid {
  double x, y, z, weight;
};

struct State {
  Cloud::Ptr points{new Cloud};
  std::vector<float> weights;
  std::vector<pcl::PointIndices> clusters;
  std::vector<Centroid> centroids;
};

Cloud::Ptr down_sample(const Cloud::Ptr& points) {
  pcl::VoxelGrid<Point> grid;
  grid.setInputCloud(points);
  grid.setLeafSize(kVoxelSize, kVoxelSize, kVoxelSize);
  grid.setDownsampleAllData(false);
  Cloud::Ptr voxels(new Cloud);
  grid.filter(*voxels);
  return voxels;
}

// Over pcl::search::Octree the same takes 1.4 times as long, at the best of its resolutions.
void extract(State& state, const Cloud::Ptr& points, double tolerance) {
  pcl::EuclideanClusterExtraction<Point> extraction;
  extraction.setClusterTolerance(tolerance);
  extraction.setMinClusterSize(1);
  extraction.setMaxClusterSize(std::numeric_limits<int>::max());
  extraction.setSearchMethod(KdTree::Ptr(new KdTree(false)));  // neighbours in no order
  extraction.setInputCloud(points);
  state.clusters.clear();
  extraction.extract(state.clusters);
}

// Weights are absent after a down-sampling, which keeps none: then every voxel weighs the same.
void take_centroids(State& state, const Cloud& points, const std::vector<float>* weights) {
  state.centroids.clear();
  for (const auto& cluster : state.clusters) {
    Centroid sum{0.0, 0.0, 0.0, 0.0};
    for (const auto i : cluster.indices) {
      const double weight = weights == nullptr ? 1.0 : (*weights)[i];
      sum.x += weight * points[i].x;
      sum.y += weight * points[i].y;
      sum.z += weight * points[i].z;
      sum.weight += weight;
    }
    state.centroids.push_back(
        {sum.x / sum.weight, sum.y / sum.weight, sum.z / sum.weight, sum.weight});
  }
}

std::size_t condense(State& state) {
  extract(state, state.points, kVoxelTolerance);
  take_centroids(state, *state.points, &state.weights);
  return state.centroids.size();
}

std::size_t fresh(State& state) {
  const Cloud::Ptr voxels = down_sample(state.points);
  extract(state, voxels, kPointTolerance);
  take_centroids(state, *voxels, nullptr);
  return state.centroids.size();
}

std::size_t fuse(State& state) { return down_sample(state.points)->size(); }

const std::map<std::string, std::size_t (*)(State&)> kRuns = {
    {"condense", condense}, {"fresh", fresh}, {"fuse", fuse}};

std::size_t load(State& state, const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  state.points->clear();
  state.weights.clear();
  float record[4];
  while (file.read(reinterpret_cast<char*>(record), sizeof record)) {
    state.points->push_back(Point(record[0], record[1], record[2]));
    state.weights.push_back(record[3]);
  }
  return state.points->size();
}

std::size_t write_labels(const State& state, const std::string& path) {
  std::vector<std::int32_t> labels(state.points->size(), -1);
  for (std::size_t k = 0; k < state.clusters.size(); ++k)
    for (const auto i : state.clusters[k].indices) labels.at(i) = static_cast<std::int32_t>(k);
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(labels.data()),
             static_cast<std::streamsize>(labels.size() * sizeof labels[0]));
  if (!file) throw std::runtime_error("cannot write " + path);
  return labels.size();
}

std::int64_t thread_nanoseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

std::string answer(State& state, const std::string& line) {
  std::istringstream words(line);
  std::string command, argument;
  words >> command >> std::ws;
  std::getline(words, argument);
  if (command == "load") return std::to_string(load(state, argument));
  if (command == "labels") return std::to_string(write_labels(state, argument));
  if (command != "run") throw std::runtime_error("no command " + command);
  const auto found = kRuns.find(argument);
  if (found == kRuns.end()) throw std::runtime_error("no run " + argument);
  const std::int64_t start = thread_nanoseconds();
  const std::size_t results = found->second(state);
  const std::int64_t spent = thread_nanoseconds() - start;
  return std::to_string(spent) + ' ' + std::to_string(results);
}

}  // namespace

int main() {
  State state;
  for (std::string line; std::getline(std::cin, line);) {
    try {
      std::cout << "ok " << answer(state, line) << std::endl;
    } catch (const std::exception& error) {
      std::cout << "error " << error.what() << std::endl;
    }
  }
}
