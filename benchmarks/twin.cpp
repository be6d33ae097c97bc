// The integrator's own algorithm in C++: a server that answers every line with one line.
//
//   load PATH            sources and cycles, see twin.py            -> ok CYCLES
//   cycle NUMBER         receive its clouds, step                   -> ok NANOSECONDS CONTACTS VOXELS
//   contacts PATH        the last contacts, 25 + sources float64    -> ok CONTACTS
//   reset                forget all hypotheses                      -> ok 0
//
// Times are the CPU time of this thread. Memory is kept from cycle to cycle, as a C++ program can
// whose results nobody holds on to. Any failure answers "error ...".
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <fstream>
#include <iostream>
#include <limits>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Key = std::int64_t;
using Vector = std::array<double, 3>;

constexpr int kAxisBits = 21;
constexpr Key kAxisMask = (Key{1} << kAxisBits) - 1;
constexpr Key kBeyond = std::numeric_limits<Key>::max();
constexpr double kLimit = 1 << 20;
constexpr Key kOrigin = (1 << 20) - 1;
constexpr double kSide = 0.005;
constexpr double kThreshold = 0.1;
constexpr std::int64_t kTimeout = 200'000'000;
constexpr std::int64_t kReachSquared = 4;
constexpr std::uint8_t kRegular = 1, kSupport = 2, kNull = 4, kForce = 8;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

enum Verdict : std::uint8_t { kSupportOnly, kBelowThreshold, kContact, kNulled };

struct Cloud {
  std::size_t source;
  std::int64_t stamp;
  std::vector<double> positions, likelihoods, spreads, forces;
  std::size_t size() const { return likelihoods.size(); }
};

// Entries or incoming rows, grouped by source; a group's forces stand together in rows of their own.
struct Columns {
  std::vector<Key> keys;
  std::vector<float> likelihoods, spreads;
  std::vector<std::int64_t> stamps;
  std::vector<std::array<double, 4>> forces;  // sums of p f and of p; or f and 1

  void make_room(std::size_t rows, std::size_t force_rows) {
    if (keys.size() < rows) {
      keys.resize(rows);
      likelihoods.resize(rows);
      spreads.resize(rows);
      stamps.resize(rows);
    }
    if (forces.size() < force_rows) forces.resize(force_rows);
  }
};

struct Range {
  std::size_t begin = 0, end = 0, forces = 0;
  bool forceful = false;
  std::size_t size() const { return end - begin; }
};

struct Contact {
  Vector position;
  double likelihood, dispersion;
  std::array<double, 9> covariance;
  std::array<double, 6> extent;
  Vector force;
  double voxels, stamp;
  std::vector<double> shares;
};

struct Sums {
  std::array<Key, 3> anchor{};
  std::int64_t voxels = 0, stamp = std::numeric_limits<std::int64_t>::min();
  double largest = 0.0, weight = 0.0, force_weight = 0.0, spread = 0.0;
  Vector first{}, force{};
  std::array<double, 6> second{};
};

struct Outline {
  Vector centre, axis;
  std::array<Vector, 3> scatter;
  double least = std::numeric_limits<double>::infinity();
  double most = -std::numeric_limits<double>::infinity();
};

template <typename T>
T* room(std::vector<T>& values, std::size_t n) {
  if (values.size() < n) values.resize(n);
  return values.data();
}

Key x_of(Key key) { return key >> (2 * kAxisBits); }
Key y_of(Key key) { return (key >> kAxisBits) & kAxisMask; }
Key z_of(Key key) { return key & kAxisMask; }

void refuse_unless_finite(const std::vector<double>& values, double low, double high) {
  bool fine = true;
  for (const double value : values) fine &= value >= low && value <= high;
  if (!fine) throw std::runtime_error("a value is out of range");
}

std::int64_t root(std::int64_t square) {
  auto found = static_cast<std::int64_t>(std::sqrt(static_cast<double>(square)));
  while (found * found > square) --found;
  while ((found + 1) * (found + 1) <= square) ++found;
  return found;
}

// The eigenvector of the largest eigenvalue, by Jacobi's rotations.
Vector longest_axis(std::array<Vector, 3> m) {
  std::array<Vector, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  const double trace = m[0][0] + m[1][1] + m[2][2];
  for (int rotation = 0; rotation < 60; ++rotation) {
    int p = 0, q = 1;
    if (std::abs(m[0][2]) > std::abs(m[p][q])) p = 0, q = 2;
    if (std::abs(m[1][2]) > std::abs(m[p][q])) p = 1, q = 2;
    if (std::abs(m[p][q]) <= 1e-16 * trace) break;
    const double angle = 0.5 * std::atan2(2.0 * m[p][q], m[q][q] - m[p][p]);
    const double c = std::cos(angle), s = std::sin(angle);
    const auto turn = [c, s](double& along, double& across) {
      const double before = along;
      along = c * before - s * across;
      across = s * before + c * across;
    };
    for (int i = 0; i < 3; ++i) turn(m[i][p], m[i][q]);
    for (int i = 0; i < 3; ++i) turn(m[p][i], m[q][i]);
    for (int i = 0; i < 3; ++i) turn(axes[i][p], axes[i][q]);
  }
  int longest = 0;
  for (int i = 1; i < 3; ++i)
    if (m[i][i] > m[longest][longest]) longest = i;
  Vector axis{axes[0][longest], axes[1][longest], axes[2][longest]};
  const double leading = *std::max_element(
      axis.begin(), axis.end(), [](double a, double b) { return std::abs(a) < std::abs(b); });
  if (leading < 0.0)
    for (double& value : axis) value = -value;
  return axis;
}

class Sorter {
 public:
  // Sort keys[begin, end) and give the rows in their order; equal keys keep theirs.
  void sort(const std::vector<Key>& keys, const Range& range, std::uint32_t* order) {
    const std::size_t n = range.size();
    if (n <= 48) {
      for (std::size_t row = range.begin; row < range.end; ++row) {
        std::size_t at = row - range.begin;
        for (; at > 0 && keys[order[at - 1]] > keys[row]; --at) order[at] = order[at - 1];
        order[at] = static_cast<std::uint32_t>(row);
      }
      return;
    }
    Key low[3] = {kAxisMask, kAxisMask, kAxisMask}, high[3] = {0, 0, 0};
    for (std::size_t row = range.begin; row < range.end; ++row) {
      const Key at[3] = {x_of(keys[row]), y_of(keys[row]), z_of(keys[row])};
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], at[axis]);
        high[axis] = std::max(high[axis], at[axis]);
      }
    }
    int bits[3];
    for (int axis = 0; axis < 3; ++axis) bits[axis] = bits_below(high[axis] - low[axis] + 1);
    const int row_bits = bits_below(static_cast<Key>(n));
    const int all_bits = bits[0] + bits[1] + bits[2], end = row_bits + all_bits;
    if (end > 63) throw std::runtime_error("the typical cycle never spreads this far");
    Key *words = room(words_, n), *spare = room(spare_, n);
    for (std::size_t i = 0; i < n; ++i) {
      const Key key = keys[range.begin + i];
      const Key x = x_of(key) - low[0], y = y_of(key) - low[1], z = z_of(key) - low[2];
      const Key offset = ((x << bits[1] | y) << bits[2]) | z;
      words[i] = offset << row_bits | static_cast<Key>(i);
    }
    const int widest = n > 4096 ? 12 : 8, passes = (all_bits + widest - 1) / widest;
    const int digit_bits = passes > 0 ? (all_bits + passes - 1) / passes : 0;
    const Key digits = (Key{1} << digit_bits) - 1;
    std::uint32_t* start = room(start_, static_cast<std::size_t>(digits + 1));
    for (int shift = row_bits; shift < end; shift += digit_bits) {
      std::fill_n(start, digits + 1, 0U);
      for (std::size_t i = 0; i < n; ++i) ++start[words[i] >> shift & digits];
      std::exclusive_scan(start, start + digits + 1, start, 0U);
      for (std::size_t i = 0; i < n; ++i) spare[start[words[i] >> shift & digits]++] = words[i];
      std::swap(words, spare);
    }
    const Key row_mask = (Key{1} << row_bits) - 1;
    for (std::size_t i = 0; i < n; ++i)
      order[i] = static_cast<std::uint32_t>(range.begin + (words[i] & row_mask));
  }

 private:
  static int bits_below(Key count) {
    int bits = 0;
    while ((Key{1} << bits) < count) ++bits;
    return bits;
  }

  std::vector<Key> words_, spare_;
  std::vector<std::uint32_t> start_;
};

class Clusters {
 public:
  // Label ascending voxels; two belong together within the reach. Gives the number of clusters.
  std::size_t label(const Key* keys, std::size_t n, std::int32_t* labels) {
    if (n == 0) return 0;
    const Key reach = root(kReachSquared);
    std::uint32_t* begin = room(begin_, n + 1);
    Key *low = room(low_, n + 1), *high = room(high_, n + 1);
    parent_ = room(parents_, n + 1);
    std::uint32_t last = 0;
    begin[0] = parent_[0] = 0;
    low[0] = keys[0];
    for (std::size_t i = 1; i < n; ++i) {
      if (keys[i] == keys[i - 1] + 1) continue;
      high[last++] = keys[i - 1];
      begin[last] = static_cast<std::uint32_t>(i);
      low[last] = keys[i];
      const bool near = keys[i] - keys[i - 1] <= reach &&
                        keys[i] >> kAxisBits == keys[i - 1] >> kAxisBits;
      parent_[last] = near ? parent_[last - 1] : last;
    }
    high[last] = keys[n - 1];
    const std::uint32_t segments = last + 1;
    begin[segments] = static_cast<std::uint32_t>(n);
    low[segments] = high[segments] = kBeyond;
    parent_[segments] = segments;
    bool clear = true;
    for (std::uint32_t s = 0; s < segments; ++s)
      clear &= (z_of(low[s]) >= reach) & (y_of(low[s]) >= reach);
    if (!clear) throw std::runtime_error("the typical cycle stays off the ends of the space");
    link(low, high, segments, reach);
    std::int32_t clusters = 0;
    std::int32_t* number = room(number_, segments);
    for (std::uint32_t s = 0; s < segments; ++s) {
      const std::uint32_t top = find(s);
      if (top == s) number[s] = clusters++;
      std::fill(labels + begin[s], labels + begin[s + 1], number[top]);
    }
    return static_cast<std::size_t>(clusters);
  }

 private:
  // Join segments within the reach; each row offset keeps its place among them.
  void link(const Key* low, const Key* high, std::uint32_t segments, Key reach) {
    struct Offset {
      Key least, most;
      std::uint32_t place;
    };
    std::vector<Offset> offsets;
    for (Key dx = 0; dx <= reach; ++dx) {
      const Key span = root(kReachSquared - dx * dx);
      for (Key dy = dx > 0 ? -span : 1; dy <= span; ++dy) {
        const Key apart = root(kReachSquared - dx * dx - dy * dy);
        const Key shift = dx * (Key{1} << 2 * kAxisBits) + dy * (Key{1} << kAxisBits);
        offsets.push_back({shift - apart, shift + apart, 0});
      }
    }
    for (std::uint32_t one = 0; one < segments; ++one) {
      std::uint32_t top = parent_[one];
      for (Offset& offset : offsets) {
        const Key nearest = low[one] - offset.most, farthest = high[one] - offset.least;
        std::uint32_t other = offset.place;
        while (high[other] < nearest) ++other;
        offset.place = other;
        for (; low[other] <= farthest; ++other) {
          if (parent_[other] == top) continue;
          join(one, other);
          top = parent_[one] = parent_[other] = find(one);
        }
      }
    }
  }

  std::uint32_t find(std::uint32_t at) {
    while (parent_[at] != at) at = parent_[at] = parent_[parent_[at]];
    return at;
  }
  void join(std::uint32_t one, std::uint32_t other) {
    one = find(one);
    other = find(other);
    parent_[std::max(one, other)] = std::min(one, other);
  }

  std::uint32_t* parent_ = nullptr;
  std::vector<std::uint32_t> parents_, begin_;
  std::vector<std::int32_t> number_;
  std::vector<Key> low_, high_;
};

class Integrator {
 public:
  explicit Integrator(std::vector<std::uint8_t> kinds)
      : kinds_(std::move(kinds)), clouds_(kinds_.size()), held_(kinds_.size()),
        ranges_(kinds_.size()), incoming_(kinds_.size()) {}

  void receive(const Cloud& cloud) {
    const double infinity = std::numeric_limits<double>::max();
    refuse_unless_finite(cloud.likelihoods, 0.0, 1.0);
    refuse_unless_finite(cloud.spreads, 0.0, infinity);
    refuse_unless_finite(cloud.forces, -infinity, infinity);
    std::vector<Key>& keys = held_[cloud.source];
    room(keys, cloud.size());
    bool fine = true;
    for (std::size_t row = 0; row < cloud.size(); ++row) {
      Key key = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const double index = std::floor(cloud.positions[3 * row + axis] * (1.0 / kSide));
        fine &= -kLimit < index && index < kLimit;
        key = key << kAxisBits | (static_cast<Key>(index) + kOrigin);
      }
      keys[row] = key;
    }
    if (!fine) throw std::runtime_error("a place is out of reach");
    clouds_[cloud.source] = &cloud;
  }

  void step(std::int64_t now) {
    absorb(now - kTimeout);
    align();
    fuse_and_judge();
    condense();
  }

  void reset() { std::fill(ranges_.begin(), ranges_.end(), Range{}); }
  std::size_t voxels() const { return voxels_; }
  const std::vector<Contact>& contacts() const { return contacts_; }

 private:
  void absorb(std::int64_t oldest) {
    stack();
    std::size_t rows = 0, force_rows = 0;
    for (std::size_t s = 0; s < kinds_.size(); ++s) {
      const std::size_t most = ranges_[s].size() + incoming_[s].size();
      rows += most;
      if (ranges_[s].forceful || incoming_[s].forceful) force_rows += most;
    }
    next_.make_room(rows, force_rows);
    order_.resize(std::max(order_.size(), rows));
    std::size_t count = 0, forces = 0;
    for (std::size_t s = 0; s < kinds_.size(); ++s) {
      sorter_.sort(rows_.keys, incoming_[s], order_.data());
      Range merged{count, count, forces, ranges_[s].forceful || incoming_[s].forceful};
      merged.end = merge(ranges_[s], incoming_[s], merged, oldest);
      ranges_[s] = merged;
      count = merged.end;
      if (merged.forceful) forces += merged.size();
    }
    std::swap(entries_, next_);
  }

  void stack() {
    std::size_t end = 0, forces = 0;
    for (std::size_t s = 0; s < clouds_.size(); ++s) {
      const std::size_t n = clouds_[s] == nullptr ? 0 : clouds_[s]->size();
      const bool forceful = n > 0 && !clouds_[s]->forces.empty();
      incoming_[s] = {end, end + n, forces, forceful};
      end += n;
      if (forceful) forces += n;
    }
    rows_.make_room(end, forces);
    for (std::size_t s = 0; s < clouds_.size(); ++s) {
      if (clouds_[s] == nullptr) continue;
      const Cloud& cloud = *clouds_[s];
      const Range& range = incoming_[s];
      std::copy_n(held_[s].begin(), cloud.size(), rows_.keys.begin() + range.begin);
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        rows_.likelihoods[range.begin + i] = static_cast<float>(cloud.likelihoods[i]);
        rows_.stamps[range.begin + i] = cloud.stamp;
        rows_.spreads[range.begin + i] =
            cloud.spreads.empty() ? 0.0F : static_cast<float>(cloud.spreads[i]);
        if (range.forceful)
          rows_.forces[range.forces + i] = {cloud.forces[3 * i], cloud.forces[3 * i + 1],
                                            cloud.forces[3 * i + 2], 1.0};
      }
      clouds_[s] = nullptr;
    }
  }

  // The newest row of a voxel wins; rows of one stamp give their largest likelihood.
  std::size_t merge(const Range& old, const Range& rows, const Range& to, std::int64_t oldest) {
    std::size_t at = old.begin, next = 0, count = to.begin;
    const std::size_t last = rows.size();
    while (at < old.end || next < last) {
      const Key key = next < last ? rows_.keys[order_[next]] : kBeyond;
      while (at < old.end && entries_.keys[at] < key) {
        next_.keys[count] = entries_.keys[at];
        next_.likelihoods[count] = entries_.likelihoods[at];
        next_.stamps[count] = entries_.stamps[at];
        next_.spreads[count] = entries_.spreads[at];
        if (to.forceful)
          next_.forces[to.forces + count - to.begin] =
              old.forceful ? entries_.forces[old.forces + at - old.begin]
                           : std::array<double, 4>{};
        count += entries_.stamps[at] >= oldest;
        ++at;
      }
      if (next == last) break;
      float likelihood = 0.0F, spread = 0.0F;
      std::int64_t stamp = 0;
      std::array<double, 4> force{};
      if (at < old.end && entries_.keys[at] == key) {
        likelihood = entries_.likelihoods[at];
        stamp = entries_.stamps[at];
        spread = entries_.spreads[at];
        if (old.forceful) force = entries_.forces[old.forces + at - old.begin];
        ++at;
      }
      for (; next < last && rows_.keys[order_[next]] == key; ++next) {
        const std::size_t row = order_[next];
        const float p = rows_.likelihoods[row];
        const bool newer = likelihood == 0.0F || rows_.stamps[row] > stamp;
        if (p == 0.0F) {
          if (newer) likelihood = p;
          continue;
        }
        if (newer || p > likelihood) {
          likelihood = p;
          stamp = rows_.stamps[row];
          spread = rows_.spreads[row];
        } else if (p == likelihood) {
          spread = std::max(spread, rows_.spreads[row]);
        }
        if (to.forceful) {
          if (newer || !rows.forceful) force = {};
          if (rows.forceful)
            for (int i = 0; i < 4; ++i)
              force[i] += double{p} * rows_.forces[rows.forces + row - rows.begin][i];
        }
      }
      next_.keys[count] = key;
      next_.likelihoods[count] = likelihood;
      next_.stamps[count] = stamp;
      next_.spreads[count] = spread;
      if (to.forceful) next_.forces[to.forces + count - to.begin] = force;
      count += likelihood > 0.0F && stamp >= oldest;
    }
    return count;
  }

  void align() {
    const std::size_t sources = kinds_.size();
    std::size_t n = ranges_.empty() ? 0 : ranges_.back().end;
    keys_ = room(voxel_keys_, n);
    bits_ = room(voxel_bits_, n);
    place_ = room(entry_places_, n);
    std::vector<Key> front(sources);
    std::vector<std::size_t> head(sources);
    std::vector<std::uint8_t> kinds = kinds_;
    for (std::size_t s = 0; s < sources; ++s) {
      head[s] = ranges_[s].begin;
      front[s] = ranges_[s].size() > 0 ? entries_.keys[head[s]] : kBeyond;
      if (kinds_[s] == kRegular && ranges_[s].forceful) kinds[s] |= kForce;
    }
    for (std::size_t count = 0;;) {
      std::size_t first = 0;
      Key key = kBeyond, second = kBeyond;
      for (std::size_t s = 0; s < sources; ++s) {
        if (front[s] < key) {
          second = key;
          key = front[s];
          first = s;
        } else {
          second = std::min(second, front[s]);
        }
      }
      if (key == kBeyond) {
        voxels_ = count;
        return;
      }
      if (key < second) {
        std::size_t at = head[first];
        const std::size_t end = ranges_[first].end;
        while (key < second) {
          keys_[count] = key;
          bits_[count] = kinds[first];
          place_[at] = static_cast<std::uint32_t>(count++);
          key = ++at < end ? entries_.keys[at] : kBeyond;
        }
        head[first] = at;
        front[first] = key;
      } else {
        keys_[count] = key;
        bits_[count] = 0;
        for (std::size_t s = 0; s < sources; ++s) {
          if (front[s] != key) continue;
          place_[head[s]] = static_cast<std::uint32_t>(count);
          bits_[count] |= kinds[s];
          front[s] = ++head[s] < ranges_[s].end ? entries_.keys[head[s]] : kBeyond;
        }
        ++count;
      }
    }
  }

  void fuse_and_judge() {
    fused_ = room(likelihoods_, voxels_);
    selected_ = room(contact_voxels_, voxels_);
    contact_keys_ = room(selected_keys_, voxels_);
    std::uint8_t* verdicts = room(verdicts_, voxels_);
    std::fill_n(fused_, voxels_, 1.0);
    for (std::size_t s = 0; s < kinds_.size(); ++s) {
      if (kinds_[s] == kNull) continue;
      for (std::size_t i = ranges_[s].begin; i < ranges_[s].end; ++i)
        fused_[place_[i]] *= 1.0 - double{entries_.likelihoods[i]};
    }
    for (std::size_t v = 0; v < voxels_; ++v) fused_[v] = 1.0 - fused_[v];
    for (std::size_t v = 0; v < voxels_; ++v) {
      const bool reaches = 1.0 - fused_[v] <= 1.0 - kThreshold + 1e-6;
      std::uint8_t verdict = reaches ? kContact : kBelowThreshold;
      verdict = bits_[v] & kRegular ? verdict : std::uint8_t{kSupportOnly};
      verdicts[v] = bits_[v] & kNull ? std::uint8_t{kNulled} : verdict;
    }
    count_ = 0;
    for (std::size_t v = 0; v < voxels_; ++v) {
      selected_[count_] = static_cast<std::uint32_t>(v);
      contact_keys_[count_] = keys_[v];
      count_ += verdicts[v] == kContact;
    }
  }

  // Add the force of each voxel, the mean over regular sources, to the sums of its cluster.
  void add_forces(std::vector<Sums>& sums, const std::uint32_t* cluster_of) {
    std::vector<std::size_t> felt;
    for (std::size_t v = 0; v < voxels_; ++v)
      if (bits_[v] & kForce && cluster_of[v] < sums.size()) felt.push_back(v);
    std::vector<Vector> mean(felt.size());
    std::vector<double> total(felt.size());
    for (std::size_t s = 0; s < kinds_.size(); ++s) {
      const Range& range = ranges_[s];
      if (kinds_[s] != kRegular || !range.forceful) continue;
      std::size_t i = 0;
      for (std::size_t entry = range.begin; entry < range.end; ++entry) {
        while (i < felt.size() && felt[i] < place_[entry]) ++i;
        const auto& force = entries_.forces[range.forces + entry - range.begin];
        if (i == felt.size() || felt[i] != place_[entry] || force[3] <= 0.0) continue;
        const double weight = entries_.likelihoods[entry];
        for (int axis = 0; axis < 3; ++axis) mean[i][axis] += weight * force[axis] / force[3];
        total[i] += weight;
      }
    }
    for (std::size_t i = 0; i < felt.size(); ++i) {
      if (total[i] <= 0.0) continue;
      Sums& sum = sums[cluster_of[felt[i]]];
      const double w = fused_[felt[i]];
      for (int axis = 0; axis < 3; ++axis) sum.force[axis] += w * (mean[i][axis] / total[i]);
      sum.force_weight += w;
    }
  }

  void condense() {
    const std::size_t sources = kinds_.size();
    std::int32_t* labels = room(labels_, count_);
    const std::size_t clusters = clusters_.label(contact_keys_, count_, labels);
    std::vector<Sums> sums(clusters);
    for (std::size_t i = 0; i < count_;) {  // one round for each cluster's voxels of one row
      const std::int32_t label = labels[i];
      const Key key = contact_keys_[i], row = key >> kAxisBits;
      Sums& sum = sums[label];
      if (sum.voxels == 0) sum.anchor = {x_of(key), y_of(key), z_of(key)};
      const auto x = static_cast<double>(x_of(key) - sum.anchor[0]);
      const auto y = static_cast<double>(y_of(key) - sum.anchor[1]);
      const std::size_t begun = i;
      double most = 0.0, w_sum = 0.0, wz_sum = 0.0, wzz_sum = 0.0;
      for (; i < count_ && labels[i] == label && contact_keys_[i] >> kAxisBits == row; ++i) {
        const double w = fused_[selected_[i]];
        const auto z = static_cast<double>(z_of(contact_keys_[i]) - sum.anchor[2]);
        most = std::max(most, w);
        w_sum += w;
        wz_sum += w * z;
        wzz_sum += w * z * z;
      }
      sum.voxels += static_cast<std::int64_t>(i - begun);
      sum.largest = std::max(sum.largest, most);
      sum.weight += w_sum;
      sum.first[0] += w_sum * x;
      sum.first[1] += w_sum * y;
      sum.first[2] += wz_sum;
      sum.second[0] += w_sum * x * x;
      sum.second[1] += w_sum * x * y;
      sum.second[2] += wz_sum * x;
      sum.second[3] += w_sum * y * y;
      sum.second[4] += wz_sum * y;
      sum.second[5] += wzz_sum;
    }
    std::uint32_t* cluster_of = room(voxel_clusters_, voxels_);
    std::fill_n(cluster_of, voxels_, static_cast<std::uint32_t>(clusters));
    for (std::size_t i = 0; i < count_; ++i)
      cluster_of[selected_[i]] = static_cast<std::uint32_t>(labels[i]);
    // Voxels of no cluster add to one row too many.
    std::vector<double> shares((clusters + 1) * sources);
    std::vector<std::array<double, 2>> moments(voxels_);  // Σ p and Σ p spread² by voxel
    std::vector<std::int64_t> stamps(clusters + 1, std::numeric_limits<std::int64_t>::min());
    for (std::size_t s = 0; s < sources; ++s) {
      if (kinds_[s] == kNull) continue;
      for (std::size_t entry = ranges_[s].begin; entry < ranges_[s].end; ++entry) {
        const std::uint32_t c = cluster_of[place_[entry]];
        const double p = entries_.likelihoods[entry], spread = entries_.spreads[entry];
        shares[c * sources + s] += p;
        moments[place_[entry]][0] += p;
        moments[place_[entry]][1] += p * spread * spread;
        stamps[c] = std::max(stamps[c], entries_.stamps[entry]);
      }
    }
    for (std::size_t i = 0; i < count_; ++i) {
      const auto& [mass, square] = moments[selected_[i]];
      sums[labels[i]].spread += fused_[selected_[i]] * square / mass;
    }
    for (std::size_t c = 0; c < clusters; ++c) sums[c].stamp = stamps[c];
    add_forces(sums, cluster_of);
    describe(sums, shares, labels);
  }

  void describe(const std::vector<Sums>& sums, std::vector<double>& shares,
                const std::int32_t* labels) {
    const std::size_t clusters = sums.size(), sources = kinds_.size();
    std::vector<Outline> outlines(clusters);
    for (std::size_t c = 0; c < clusters; ++c) {
      const Sums& sum = sums[c];
      Outline& line = outlines[c];
      Vector mean;
      for (int i = 0; i < 3; ++i) {
        mean[i] = sum.first[i] / sum.weight;
        line.centre[i] = static_cast<double>(sum.anchor[i]) + mean[i];
      }
      for (int i = 0, k = 0; i < 3; ++i)
        for (int j = i; j < 3; ++j, ++k)
          line.scatter[i][j] = line.scatter[j][i] =
              sum.second[k] / sum.weight - mean[i] * mean[j];
      line.axis = longest_axis(line.scatter);
    }
    for (std::size_t i = 0; i < count_; ++i) {
      Outline& line = outlines[labels[i]];
      const Key key = contact_keys_[i];
      const double along =
          (static_cast<double>(x_of(key)) - line.centre[0]) * line.axis[0] +
          (static_cast<double>(y_of(key)) - line.centre[1]) * line.axis[1] +
          (static_cast<double>(z_of(key)) - line.centre[2]) * line.axis[2];
      line.least = std::min(line.least, along);
      line.most = std::max(line.most, along);
    }
    std::vector<std::size_t> falling(clusters);
    std::iota(falling.begin(), falling.end(), std::size_t{0});
    std::stable_sort(falling.begin(), falling.end(), [&sums](std::size_t a, std::size_t b) {
      return std::round(sums[a].largest * 1e6) > std::round(sums[b].largest * 1e6);
    });
    contacts_.clear();
    for (const std::size_t c : falling) {
      const Sums& sum = sums[c];
      const Outline& line = outlines[c];
      Contact contact;
      double spread = 0.0;
      for (int i = 0; i < 3; ++i) {
        contact.position[i] = (line.centre[i] - static_cast<double>(kOrigin) + 0.5) * kSide;
        contact.extent[i] = contact.position[i] + line.least * line.axis[i] * kSide;
        contact.extent[3 + i] = contact.position[i] + line.most * line.axis[i] * kSide;
        contact.force[i] = sum.force_weight > 0.0 ? sum.force[i] / sum.force_weight : kNan;
        for (int j = 0; j < 3; ++j)
          contact.covariance[3 * i + j] =
              (line.scatter[i][j] + (i == j ? 1.0 / 12.0 : 0.0)) * kSide * kSide;
        contact.covariance[4 * i] += sum.spread / sum.weight;
        spread += line.scatter[i][i];
      }
      contact.likelihood = sum.largest;
      contact.dispersion = std::sqrt(std::max(spread, 0.0)) * kSide;
      contact.voxels = static_cast<double>(sum.voxels);
      contact.stamp = static_cast<double>(sum.stamp) / 1e9;
      const auto share = shares.begin() + static_cast<std::ptrdiff_t>(c * sources);
      contact.shares.assign(share, share + static_cast<std::ptrdiff_t>(sources));
      const double total = std::accumulate(share, share + static_cast<std::ptrdiff_t>(sources), 0.0);
      for (double& value : contact.shares) value /= total;
      contacts_.push_back(std::move(contact));
    }
  }

  std::vector<std::uint8_t> kinds_;
  std::vector<const Cloud*> clouds_;
  std::vector<std::vector<Key>> held_;
  std::vector<Range> ranges_, incoming_;
  Columns entries_, next_, rows_;
  Sorter sorter_;
  Clusters clusters_;
  std::vector<Contact> contacts_;
  std::vector<Key> voxel_keys_, selected_keys_;
  std::vector<std::uint8_t> voxel_bits_, verdicts_;
  std::vector<std::int32_t> labels_;
  std::vector<std::uint32_t> order_, contact_voxels_, entry_places_, voxel_clusters_;
  std::vector<double> likelihoods_;
  Key *keys_ = nullptr, *contact_keys_ = nullptr;
  std::uint8_t* bits_ = nullptr;
  std::uint32_t *place_ = nullptr, *selected_ = nullptr;
  double* fused_ = nullptr;
  std::size_t voxels_ = 0, count_ = 0;
};

struct State {
  std::vector<std::uint8_t> kinds;
  std::vector<std::vector<Cloud>> cycles;
  Integrator integrator{{}};
};

template <typename T>
T take(std::istream& file) {
  T value;
  if (!file.read(reinterpret_cast<char*>(&value), sizeof value))
    throw std::runtime_error("the file ends too soon");
  return value;
}

std::vector<double> take_doubles(std::istream& file, std::int64_t n) {
  std::vector<double> values(static_cast<std::size_t>(n));
  if (!file.read(reinterpret_cast<char*>(values.data()), n * 8))
    throw std::runtime_error("the file ends too soon");
  return values;
}

std::size_t load(State& state, const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  state.kinds.clear();
  for (auto left = take<std::int64_t>(file); left > 0; --left)
    state.kinds.push_back(static_cast<std::uint8_t>(take<std::int64_t>(file)));
  state.cycles.assign(static_cast<std::size_t>(take<std::int64_t>(file)), {});
  for (auto& cycle : state.cycles) {
    for (auto left = take<std::int64_t>(file); left > 0; --left) {
      Cloud cloud{static_cast<std::size_t>(take<std::int64_t>(file)), take<std::int64_t>(file)};
      const auto n = take<std::int64_t>(file);
      const auto spreads = take<std::int64_t>(file), forces = take<std::int64_t>(file);
      cloud.positions = take_doubles(file, 3 * n);
      cloud.likelihoods = take_doubles(file, n);
      cloud.spreads = take_doubles(file, spreads);
      cloud.forces = take_doubles(file, 3 * forces);
      cycle.push_back(std::move(cloud));
    }
  }
  state.integrator = Integrator(state.kinds);
  return state.cycles.size();
}

std::int64_t thread_nanoseconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

std::string run_cycle(State& state, std::size_t number) {
  const std::vector<Cloud>& cycle = state.cycles.at(number);
  const std::int64_t start = thread_nanoseconds();
  for (const Cloud& cloud : cycle) state.integrator.receive(cloud);
  state.integrator.step(cycle.at(0).stamp);
  const std::int64_t spent = thread_nanoseconds() - start;
  return std::to_string(spent) + ' ' + std::to_string(state.integrator.contacts().size()) + ' ' +
         std::to_string(state.integrator.voxels());
}

std::size_t write_contacts(const State& state, const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  const auto put = [&file](const double* values, std::size_t n) {
    file.write(reinterpret_cast<const char*>(values), static_cast<std::streamsize>(8 * n));
  };
  for (const Contact& contact : state.integrator.contacts()) {
    put(contact.position.data(), 3);
    put(&contact.likelihood, 1);
    put(&contact.dispersion, 1);
    put(contact.covariance.data(), 9);
    put(contact.extent.data(), 6);
    put(contact.force.data(), 3);
    put(&contact.voxels, 1);
    put(&contact.stamp, 1);
    put(contact.shares.data(), contact.shares.size());
  }
  if (!file) throw std::runtime_error("cannot write " + path);
  return state.integrator.contacts().size();
}

std::string answer(State& state, const std::string& line) {
  std::istringstream words(line);
  std::string command, argument;
  words >> command >> std::ws;
  std::getline(words, argument);
  if (command == "load") return std::to_string(load(state, argument));
  if (command == "cycle") return run_cycle(state, std::stoul(argument));
  if (command == "contacts") return std::to_string(write_contacts(state, argument));
  if (command != "reset") throw std::runtime_error("no command " + command);
  state.integrator.reset();
  return "0";
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
