#include "imu_io/recordings/ros_bag.h"

#include <bzlib.h>
#include <fmt/format.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <span>

#include "imu_io/base/bytes.h"
#include "imu_io/base/file_kind.h"
#include "imu_io/base/files.h"
#include "imu_io/base/text.h"

namespace turncal {
namespace {

using ByteSpan = std::span<const std::byte>;

constexpr std::uint64_t most_bytes = std::uint64_t{256} << 20;  // limit for a record or a chunk, whatever a header says

constexpr std::int64_t second = 1'000'000'000, minute = 60 * second;  // ns

std::string_view text_of(ByteSpan bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

// ---- messages ----

enum class Encoding { cdr, ros1, other };

std::size_t aligned(std::size_t at, std::size_t step) { return (at + step - 1) & ~(step - 1); }

// A sensor_msgs/Imu is a header and 37 doubles: orientation, angular_velocity and linear_acceleration, each followed by nine covariances.
using ImuNumbers = std::array<double, 37>;
constexpr std::array<std::size_t, 6> imu_places{13, 14, 15, 25, 26, 27};
constexpr std::size_t orientation_w = 3;
constexpr std::array<std::size_t, 3> covariance_places{4, 16, 28};  // a covariance of -1 means not measured

// Reads the numbers of a serialised message in order. After a read past the end, good() is false and every read returns 0.
class MessageReader {
 public:
  MessageReader(ByteSpan data, Encoding encoding) : data_(data) {
    if (encoding == Encoding::ros1) return;
    const unsigned kind =
        data.size() < 4 ? 2 : 256 * std::to_integer<unsigned>(data[0]) + std::to_integer<unsigned>(data[1]);
    good_ = kind == 0 || kind == 1 || kind == 6 || kind == 7;  // CDR, XCDR2; even numbers are big-endian
    swapped_ = kind % 2 == 0;
    align_ = kind >= 6 ? 4 : 8;
    data_ = good_ ? data.subspan(4) : ByteSpan{};
  }

  template <class T>
  T get() {
    const std::size_t step = std::min(sizeof(T), align_);
    at_ = aligned(at_, step);
    const ByteSpan bytes = take(sizeof(T));
    if (bytes.empty()) return T{};
    if (!swapped_) return load_bytes<T>(bytes.data());
    std::array<std::byte, sizeof(T)> reversed;
    std::ranges::reverse_copy(bytes, reversed.begin());
    return load_bytes<T>(reversed.data());
  }
  ByteSpan take(std::size_t count) {
    good_ = good_ && at_ <= data_.size() && count <= data_.size() - at_;
    if (!good_) return {};
    at_ += count;
    return data_.subspan(at_ - count, count);
  }
  bool good() const { return good_; }

 private:
  ByteSpan data_;
  std::size_t at_ = 0, align_ = 1;
  bool swapped_ = false, good_ = true;
};

// Reads the stamp of a std_msgs/Header in nanoseconds.
std::int64_t read_header(MessageReader& message, Encoding encoding) {
  if (encoding == Encoding::ros1) message.get<std::uint32_t>();  // seq
  const std::int64_t seconds = message.get<std::int32_t>();
  const std::int64_t nanoseconds = message.get<std::uint32_t>();
  message.take(message.get<std::uint32_t>());  // frame_id
  return seconds * second + nanoseconds;
}

struct Topic {
  std::string name, type;
  Encoding encoding = Encoding::other;
  std::int64_t messages = 0;
  bool is_imu = type == "sensor_msgs/msg/Imu" || type == "sensor_msgs/Imu";
  bool is_temperature = type == "sensor_msgs/msg/Temperature" || type == "sensor_msgs/Temperature";
};

struct Reading {
  std::int64_t stamp_ns = 0, recorded_ns = 0;
  double celsius = 0.0;
};

constexpr const char* imu_fields[] = {"angular_velocity.x",    "angular_velocity.y",    "angular_velocity.z",
                                      "linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"};

// Receives the messages of all topics and keeps those of one unit.
class Collector {
 public:
  Collector(const std::string& path, const std::string& wanted, bool skip_bad)
      : path_(path), wanted_(wanted), skip_bad_(skip_bad) {}

  Topic& topic(std::string_view name, std::string_view type, Encoding encoding) {
    const auto [at, is_new] = topics_.try_emplace(std::string(name));
    if (is_new) at->second = {std::string(name), std::string(type), encoding};
    if (is_new && at->second.is_imu) units_.push_back(&at->second);
    return at->second;
  }

  Status take(Topic& topic, std::int64_t recorded_ns, ByteSpan data) {
    ++topic.messages;
    if (topic.encoding == Encoding::other) return {};
    if (!topic.is_imu) {
      if (topic.is_temperature) take_temperature(topic, recorded_ns, data);
      return {};
    }
    if (unit_ == nullptr && (wanted_.empty() || topic.name == wanted_)) unit_ = &topic;
    return &topic == unit_ ? take_imu(recorded_ns, data) : Status();
  }

  bool skips_bad() const { return skip_bad_; }
  // Returns an error, or counts the damage if it is to be skipped.
  Status damaged(const std::string& what) {
    if (!skip_bad_ && !stamps_.empty())
      return input_error("{}: {}; {} came before: --skip-bad-rows takes what is whole", path_, what,
                         counted(std::ssize(stamps_), "message"));
    const Error error = input_error(path_ + ": " + what);
    if (!skip_bad_) return error;
    if (result_.bad++ == 0) result_.first_bad = error.message;
    return {};
  }
  Status damaged_at(std::uint64_t byte, const std::string& what) {
    return damaged(fmt::format("byte {}: {}", byte, what));
  }

  Result<BagImu> finish() {
    TRY(check_unit());
    result_.topic = unit_->name;
    const auto is_unset = [](std::int64_t stamp) { return stamp == 0; };
    result_.recording_times = std::ranges::all_of(stamps_, is_unset);
    TRY(keep_in_order());
    if (stamps_.empty()) return input_error(path_ + ": no good message of topic " + quoted(unit_->name));
    const std::vector<std::int64_t>& times = result_.recording_times ? recorded_ : stamps_;
    constexpr std::int64_t year_2000 = 946'684'800 * second;
    if (times.front() > year_2000) result_.started_utc_s = times.front() / second;
    NumberColumn t{"t", std::vector<double>(times.size())};
    // Stamps of a damaged bag may have any value: unsigned arithmetic may wrap.
    const auto since_first = [first = std::uint64_t(times.front())](std::int64_t time) {
      return 1e-9 * double(std::int64_t(std::uint64_t(time) - first));
    };
    std::ranges::transform(times, t.values.begin(), since_first);
    result_.columns.push_back(std::move(t));
    for (std::size_t k = 0; k < 6; ++k) result_.columns.push_back({imu_fields[k], std::move(values_[k])});
    add_temperature(times);
    return std::move(result_);
  }

 private:
  Status take_imu(std::int64_t recorded_ns, ByteSpan data) {
    MessageReader message(data, unit_->encoding);
    const std::int64_t stamp = read_header(message, unit_->encoding);
    ImuNumbers numbers{};
    for (double& number : numbers) number = message.get<double>();
    const auto defect = [&](const std::string& what) {
      return damaged(fmt::format("message {} of {}: {}", unit_->messages, quoted(unit_->name), what));
    };
    if (!message.good()) return defect("expected a sensor_msgs/Imu, found something shorter or in another encoding");
    for (std::size_t k = 0; k < 6; ++k)
      if (!std::isfinite(numbers[imu_places[k]]))
        return defect(fmt::format("{} = '{}': expected a finite number", imu_fields[k], numbers[imu_places[k]]));
    if (numbers[covariance_places[1]] == -1.0) return defect("angular_velocity is not measured, says its covariance");
    if (numbers[covariance_places[2]] == -1.0)
      return defect("linear_acceleration is not measured, says its covariance");
    for (std::size_t k = 0; k < 6; ++k) values_[k].push_back(numbers[imu_places[k]]);
    stamps_.push_back(stamp);
    recorded_.push_back(recorded_ns);
    result_.message.push_back(unit_->messages - 1);
    return {};
  }

  void take_temperature(const Topic& topic, std::int64_t recorded_ns, ByteSpan data) {
    MessageReader message(data, topic.encoding);
    const std::int64_t stamp = read_header(message, topic.encoding);
    const double celsius = message.get<double>();
    if (message.good() && std::isfinite(celsius)) temperatures_[topic.name].push_back({stamp, recorded_ns, celsius});
  }

  // Sorts the messages by time of recording unless their stamps increase already (the recorder's clock may have been set). Drops messages without
  // a stamp if others have one, except a first stamp of 0, where a simulation's clock begins.
  Status keep_in_order() {
    std::vector<std::size_t> order(stamps_.size()), kept;
    std::iota(order.begin(), order.end(), 0);
    if (!std::ranges::is_sorted(result_.recording_times ? recorded_ : stamps_))
      std::ranges::stable_sort(order, {}, [&](std::size_t row) { return recorded_[row]; });
    const auto unset = std::ranges::count(stamps_, 0);
    const bool at_zero = unset == 1 && stamps_[order.front()] == 0 && stamps_.size() > 1 && stamps_[order[1]] < minute;
    for (const std::size_t row : order)
      if (stamps_[row] != 0 || result_.recording_times || at_zero)
        kept.push_back(row);
      else
        TRY(damaged(fmt::format("message {} of {}: header.stamp is 0, as of {} of {} messages: expected a time",
                                result_.message[row] + 1, quoted(unit_->name), unset, stamps_.size())));
    const auto keep = [&](auto& values) {
      std::remove_reference_t<decltype(values)> all;
      for (const std::size_t row : kept) all.push_back(values[row]);
      values = std::move(all);
    };
    if (std::ranges::is_sorted(kept) && kept.size() == stamps_.size()) return {};
    for (auto& values : values_) keep(values);
    keep(stamps_), keep(recorded_);
    // Renumbers the messages in the new order; a dropped message takes its number with it.
    std::vector<std::int64_t> numbers = std::move(result_.message);
    std::ranges::sort(numbers);
    result_.message.clear();
    for (std::size_t place = 0, at = 0; place < order.size(); ++place)
      if (at < kept.size() && order[place] == kept[at]) result_.message.push_back(numbers[place]), ++at;
    return {};
  }

  // Of several thermometers, takes the topic that shares the longest beginning with the unit's.
  void add_temperature(const std::vector<std::int64_t>& times) {
    const auto common = [&](const auto& entry) {
      return std::ranges::mismatch(entry.first, unit_->name).in1 - entry.first.begin();
    };
    const auto nearest = std::ranges::max_element(temperatures_, {}, common);
    if (nearest == temperatures_.end()) return;
    std::ranges::stable_sort(nearest->second, {}, [&](const Reading& reading) { return time_of(reading); });
    result_.temperature_topic = nearest->first;
    NumberColumn column{"temperature", std::vector<double>(times.size(), std::numeric_limits<double>::quiet_NaN())};
    std::size_t row = 0;
    for (const Reading& reading : nearest->second) {
      while (row < times.size() && times[row] < time_of(reading)) ++row;
      if (row < times.size()) column.values[row] = reading.celsius;
    }
    result_.columns.push_back(std::move(column));
  }

  std::int64_t time_of(const Reading& reading) const {
    return result_.recording_times ? reading.recorded_ns : reading.stamp_ns;
  }

  Status check_unit() const {
    std::vector<std::string> list, names;
    for (const Topic* unit : units_) names.push_back(unit->name);
    for (const auto& [name, topic] : topics_)
      if (list.size() < 30)
        list.push_back(
            fmt::format("{} ({}, {})", quoted(name), quoted(topic.type), counted(topic.messages, "message")));
    const std::string topics =
        fmt::format("it has {}", list.empty() ? "no topics" : fmt::format("{}", fmt::join(list, ", ")));
    const auto refuse = [&](const std::string& what) { return input_error(path_ + ": " + what); };
    const auto spoken = std::ranges::count_if(units_, [](const Topic* unit) { return unit->messages > 0; });
    if (!wanted_.empty() && std::ranges::find(units_, wanted_, &Topic::name) == units_.end())
      return refuse(fmt::format("no topic {} of type sensor_msgs/msg/Imu: {}{}", quoted(wanted_), topics,
                                did_you_mean(wanted_, names)));
    if (wanted_.empty() && spoken > 1) return refuse("several units: expected --topic with the name of one: " + topics);
    if (unit_ == nullptr)
      return refuse("no message of type sensor_msgs/msg/Imu in an encoding that is read here (cdr, ros1): " + topics);
    return stamps_.empty() ? refuse("no good message of topic " + quoted(unit_->name)) : Status();
  }

  const std::string& path_;
  const std::string& wanted_;
  bool skip_bad_;
  std::map<std::string, Topic, std::less<>> topics_;
  std::vector<const Topic*> units_;
  const Topic* unit_ = nullptr;
  std::array<std::vector<double>, 6> values_;
  std::vector<std::int64_t> stamps_, recorded_;
  std::map<std::string, std::vector<Reading>> temperatures_;
  BagImu result_;
};

// ---- files ----

class Decompressor {
 public:
  // Returns the `size` decompressed bytes, valid until the next call; nothing if they are damaged.
  std::optional<ByteSpan> operator()(std::string_view compression, ByteSpan data, std::uint64_t size) {
    if (compression.empty() || compression == "none") return data.size() == size ? std::optional(data) : std::nullopt;
    if (size > most_bytes) return {};
    if (size > room_ || !buffer_) buffer_ = std::make_unique_for_overwrite<std::byte[]>(room_ = size);
    const bool good = compression == "zstd"
                          ? ZSTD_decompressDCtx(zstd_.get(), buffer_.get(), size, data.data(), data.size()) == size
                      : compression == "lz4" ? lz4(data, size)
                                             : bz2(data, size);
    return good ? std::optional(ByteSpan(buffer_.get(), size)) : std::nullopt;
  }

 private:
  bool lz4(ByteSpan data, std::uint64_t size) {
    LZ4F_resetDecompressionContext(lz4_.get());
    std::uint64_t made = 0;
    for (std::size_t hint = 1; hint != 0;) {
      std::size_t out = size - made, in = data.size();
      hint = LZ4F_decompress(lz4_.get(), buffer_.get() + made, &out, data.data(), &in, nullptr);
      if (LZ4F_isError(hint) != 0 || (out == 0 && in == 0)) return false;
      made += out;
      data = data.subspan(in);
    }
    return made == size;
  }
  bool bz2(ByteSpan data, std::uint64_t size) {
    auto made = unsigned(size);
    char* const packed = const_cast<char*>(text_of(data).data());
    return BZ2_bzBuffToBuffDecompress(reinterpret_cast<char*>(buffer_.get()), &made, packed, unsigned(data.size()), 0,
                                      0) == BZ_OK &&
           made == size;
  }
  static LZ4F_dctx* new_lz4() {
    LZ4F_dctx* context = nullptr;
    LZ4F_createDecompressionContext(&context, LZ4F_VERSION);
    return context;
  }
  std::unique_ptr<std::byte[]> buffer_;
  std::uint64_t room_ = 0;
  std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> zstd_{ZSTD_createDCtx(), ZSTD_freeDCtx};
  std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> lz4_{new_lz4(), LZ4F_freeDecompressionContext};
};

// The common part of MCAP and rosbag1: a sequence of records, some of which are chunks of compressed records.
class RecordReader {
 public:
  RecordReader(const PosixFile& file, std::uint64_t size, Collector& collector)
      : collector_(collector), file_(file), window_(file, size) {}

 protected:
  Status damaged(const std::string& what) { return collector_.damaged_at(begun_, what); }
  Result<std::optional<ByteSpan>> unpack(std::string_view compression, ByteSpan packed, std::uint64_t size) {
    const auto known = {"", "none", "zstd", "lz4", "bz2"};
    if (std::ranges::find(known, compression) == known.end())
      return input_error("{}: byte {}: compression {}: expected zstd, lz4, bz2 or none", file_.path(), begun_,
                         quoted(compression));
    const std::optional<ByteSpan> records = decompress_(compression, packed, size);
    if (!records) TRY(damaged(fmt::format("the chunk does not decompress to the {} bytes that it promises", size)));
    return records;
  }

  std::uint64_t left() const { return window_.end() - at_; }
  void skip(std::uint64_t count) { at_ += std::min(count, left()); }
  // REQUIRES: count <= left(). Valid until the next call.
  Result<ByteSpan> take_bytes(std::uint64_t count) {
    const ByteSpan bytes = TRY(window_.at(at_, count));
    if (bytes.size() < count) return input_error(file_.path() + ": became shorter while it was read");
    at_ += count;
    return bytes.first(count);
  }

  Collector& collector_;
  std::uint64_t at_ = 0, begun_ = 0;  // begun_: start of the current record

 private:
  const PosixFile& file_;
  FileWindow window_;
  Decompressor decompress_;
};

// MCAP: magic, then records of op (u8), length (u64) and content; a chunk holds compressed records.
namespace mcap {
constexpr std::string_view magic = "\x89MCAP0\r\n";
enum Op : std::uint8_t {
  header = 1,
  footer,
  schema,
  channel,
  message,
  chunk,
  message_index,
  chunk_index,
  statistics = 11,
  data_end = 15
};
}  // namespace mcap

class McapReader : public RecordReader {
 public:
  using RecordReader::RecordReader;

  Status read() {
    constexpr std::size_t head_bytes = 9;
    skip(mcap::magic.size());
    for (;;) {
      begun_ = at_;
      if (left() < head_bytes) return damaged("the MCAP file is cut off");
      const ByteSpan head = TRY(take_bytes(head_bytes));
      const auto op = std::to_integer<int>(head[0]);
      const auto length = load_bytes<std::uint64_t>(head.data() + 1);
      if (op == mcap::data_end || op == mcap::footer) return {};
      if (length > left()) return damaged("the MCAP file is cut off");
      if (op != mcap::schema && op != mcap::channel && op != mcap::message && op != mcap::chunk) {
        skip(length);
      } else if (length > most_bytes) {
        TRY(damaged(fmt::format("a record of {} bytes: expected at most {}", length, most_bytes)));
        skip(length);
      } else {
        const ByteSpan content = TRY(take_bytes(length));
        TRY(take(op, content));
      }
    }
  }

 private:
  Status take(int op, ByteSpan content) {
    ByteReader reader(content);
    if (op == mcap::chunk) return take_chunk(reader);
    const auto id = reader.get<std::uint16_t>();
    if (op == mcap::message) {
      reader.get<std::uint32_t>();  // sequence
      const auto recorded_ns = std::int64_t(reader.get<std::uint64_t>());
      reader.get<std::uint64_t>();  // publish_time
      const auto at = channels_.find(id);
      if (!reader.good() || at == channels_.end())
        return damaged("a message that is cut off, or of a channel that is not there");
      return collector_.take(*at->second, recorded_ns, reader.get_bytes(content.size() - 22));
    }
    const auto of_schema = op == mcap::channel ? reader.get<std::uint16_t>() : std::uint16_t{0};
    const std::string name = reader.get_text();
    const std::string encoding = reader.get_text();
    if (!reader.good()) return damaged("a schema or channel that is cut off");
    if (op == mcap::schema)
      schemas_[id] = name;
    else
      channels_[id] = &collector_.topic(name, schemas_[of_schema],
                                        encoding == "cdr"    ? Encoding::cdr
                                        : encoding == "ros1" ? Encoding::ros1
                                                             : Encoding::other);
    return {};
  }

  Status take_chunk(ByteReader& reader) {
    reader.get_bytes(16);  // first and last time
    const auto size = reader.get<std::uint64_t>();
    const auto crc = reader.get<std::uint32_t>();
    const std::string compression = reader.get_text();
    const ByteSpan packed = reader.get_bytes(reader.get<std::uint64_t>());
    if (!reader.good()) return damaged("a chunk that is cut off");
    const std::optional<ByteSpan> records = TRY(unpack(compression, packed, size));
    if (!records) return {};
    if (crc != 0 && crc != crc32_z(0, reinterpret_cast<const Bytef*>(records->data()), records->size()))
      return damaged("the checksum of the chunk is wrong");
    ByteReader inner(*records);
    while (!inner.at_end()) {
      const auto op = inner.get<std::uint8_t>();
      const ByteSpan content = inner.get_bytes(inner.get<std::uint64_t>());
      if (!inner.good()) return damaged("a record inside the chunk is cut off");
      if (op == mcap::schema || op == mcap::channel || op == mcap::message) TRY(take(op, content));
    }
    return {};
  }

  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, Topic*> channels_;
};

// rosbag1: a line of magic, then records of a header (fields `name=value`) and data, each preceded by its length (u32).
class Rosbag1Reader : public RecordReader {
 public:
  using RecordReader::RecordReader;

  Status read() {
    constexpr std::string_view magic = "#ROSBAG V2.0\n";
    if (left() < magic.size() || text_of(TRY(take_bytes(magic.size()))) != magic)
      return damaged("expected a bag of version 2.0");
    std::vector<std::byte> header;
    while (left() > 0) {
      begun_ = at_;
      for (const bool is_data : {false, true}) {
        const std::uint64_t length = left() < 4 ? most_bytes + 1 : load_bytes<std::uint32_t>(TRY(take_bytes(4)).data());
        if (length > std::min(most_bytes, left())) return damaged("the bag is cut off");
        const ByteSpan part = TRY(take_bytes(length));
        if (is_data)
          TRY(take(header, part));
        else
          header.assign(part.begin(), part.end());
      }
    }
    return {};
  }

 private:
  enum Op { message = 2, chunk = 5, connection = 7 };

  static ByteSpan field(ByteSpan header, const std::string& name) {
    for (ByteReader reader(header); reader.good() && !reader.at_end();)
      if (const ByteSpan entry = reader.get_bytes(reader.get<std::uint32_t>()); text_of(entry).starts_with(name + "="))
        return entry.subspan(name.size() + 1);
    return {};
  }
  template <class T>
  static std::optional<T> number(ByteSpan header, const char* name) {
    const ByteSpan value = field(header, name);
    return value.size() == sizeof(T) ? std::optional(load_bytes<T>(value.data())) : std::nullopt;
  }

  Status take(ByteSpan header, ByteSpan data) {
    const int op = number<std::uint8_t>(header, "op").value_or(0);
    if (op == chunk) return take_chunk(header, data);
    const auto id = number<std::uint32_t>(header, "conn");
    if (op == connection && id)
      connections_[*id] =
          &collector_.topic(text_of(field(header, "topic")), text_of(field(data, "type")), Encoding::ros1);
    if (op != message) return {};
    const auto time = number<std::uint64_t>(header, "time");  // lower half: seconds; upper half: nanoseconds
    const auto at = connections_.find(id.value_or(0));
    if (!id || !time || at == connections_.end())
      return damaged("a message without time, or of a connection that is not there");
    return collector_.take(*at->second, std::int64_t((*time & 0xffffffff) * second + (*time >> 32)), data);
  }

  Status take_chunk(ByteSpan header, ByteSpan data) {
    const std::uint64_t size = number<std::uint32_t>(header, "size").value_or(0);
    const std::optional<ByteSpan> records = TRY(unpack(text_of(field(header, "compression")), data, size));
    if (!records) return {};
    ByteReader inner(*records);
    while (!inner.at_end()) {
      const ByteSpan record = inner.get_bytes(inner.get<std::uint32_t>());
      const ByteSpan content = inner.get_bytes(inner.get<std::uint32_t>());
      if (!inner.good()) return damaged("a record inside the chunk is cut off");
      if (number<std::uint8_t>(record, "op") != chunk) TRY(take(record, content));
    }
    return {};
  }

  std::map<std::uint32_t, Topic*> connections_;
};

// rosbag2: an SQLite database with the tables topics and messages. Its schema is not trusted: its views and functions are not used.
class Rosbag2Reader {
 public:
  Rosbag2Reader(const std::string& path, Collector& collector) : path_(path), collector_(collector) {}

  Status read() {
    sqlite3* handle = nullptr;
    const int code = sqlite3_open_v2(path_.c_str(), &handle, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, nullptr);
    database_.reset(handle);
    if (code != SQLITE_OK) return refusal();
    sqlite3_db_config(handle, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    sqlite3_db_config(handle, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
    if (collector_.skips_bad())
      sqlite3_db_config(handle, SQLITE_DBCONFIG_WRITABLE_SCHEMA, 1, nullptr);          // also opens a truncated file
    sqlite3_exec(handle, "PRAGMA mmap_size = 2147418112", nullptr, nullptr, nullptr);  // halves the time
    sqlite3_limit(handle, SQLITE_LIMIT_LENGTH, int(most_bytes));
    TRY(each("SELECT id, name, type, serialization_format FROM topics", [&](sqlite3_stmt* row) {
      const Encoding encoding = text_of(blob(row, 3)) == "cdr" ? Encoding::cdr : Encoding::other;
      topics_[sqlite3_column_int64(row, 0)] = &collector_.topic(text_of(blob(row, 1)), text_of(blob(row, 2)), encoding);
      return Status();
    }));
    // In the order of writing; reading by time would cause random access to the disk.
    return each("SELECT topic_id, timestamp, data FROM messages ORDER BY id", [&](sqlite3_stmt* row) -> Status {
      const auto at = topics_.find(sqlite3_column_int64(row, 0));
      if (at == topics_.end()) return collector_.damaged("a message of a topic that is not there");
      return take(*at->second, sqlite3_column_int64(row, 1), blob(row, 2));
    });
  }

 private:
  Error refusal() const {
    return input_error("{}: cannot read it as a rosbag2 database: {}", path_, sqlite3_errmsg(database_.get()));
  }
  static ByteSpan blob(sqlite3_stmt* row, int column) {
    const void* const data = sqlite3_column_blob(row, column);
    return {static_cast<const std::byte*>(data), std::size_t(sqlite3_column_bytes(row, column))};
  }

  template <class Take>
  Status each(const char* sql, Take take) {
    sqlite3_stmt* prepared = nullptr;
    const int code = sqlite3_prepare_v2(database_.get(), sql, -1, &prepared, nullptr);
    const std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> statement(prepared, sqlite3_finalize);
    if (code != SQLITE_OK) return refusal();
    int step = SQLITE_ROW;
    while ((step = sqlite3_step(prepared)) == SQLITE_ROW) TRY(take(prepared));
    return step == SQLITE_DONE ? Status() : collector_.damaged(refusal().message.substr(path_.size() + 2));
  }

  // With `ros2 bag record --compression-mode message` every message is a zstd frame.
  Status take(Topic& topic, std::int64_t recorded_ns, ByteSpan data) {
    constexpr std::string_view zstd_magic = "\x28\xB5\x2F\xFD";
    if (!text_of(data).starts_with(zstd_magic)) return collector_.take(topic, recorded_ns, data);
    const auto message = decompress_("zstd", data, ZSTD_getFrameContentSize(data.data(), data.size()));
    return message ? collector_.take(topic, recorded_ns, *message)
                   : collector_.damaged("a message of topic " + quoted(topic.name) + " does not decompress");
  }

  const std::string& path_;
  Collector& collector_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> database_{nullptr, sqlite3_close};
  Decompressor decompress_;
  std::map<std::int64_t, Topic*> topics_;
};

// Returns the files of a rosbag2 folder in the order of metadata.yaml: lines `- bag_0.db3` below relative_file_paths.
Result<std::vector<std::string>> files_of(const std::string& path) {
  const std::string metadata = path + "/metadata.yaml";
  if (!path_exists(metadata)) return std::vector<std::string>{path};
  const std::string content = TRY(read_whole_file(metadata));
  std::vector<std::string> files;
  bool listed = false;
  for (std::string_view left = content; !left.empty();) {
    std::string_view line = trimmed(next_line(left));
    listed = line.starts_with("relative_file_paths:") || (listed && line.starts_with("- "));
    if (!listed || !line.starts_with("- ")) continue;
    line = trimmed(line.substr(2));
    if (line.size() > 1 && (line.front() == '"' || line.front() == '\'') && line.back() == line.front())
      line = line.substr(1, line.size() - 2);
    files.push_back(path + "/" + std::string(line));
  }
  if (files.empty()) return input_error(metadata + ": expected relative_file_paths with a line '- FILE' for each file");
  return files;
}

// ---- writing ----

using Bytes = std::vector<std::byte>;

template <class Number>
void append_field(Bytes& out, Number value) {
  append_bytes(out, value);
}
void append_field(Bytes& out, std::string_view text) { append_text(out, text); }
void append_field(Bytes& out, const Bytes& bytes) { out.insert(out.end(), bytes.begin(), bytes.end()); }
template <class... Fields>
void append_record(Bytes& out, mcap::Op op, const Fields&... fields) {
  append_bytes(out, std::uint8_t(op));
  const std::size_t at = out.size();
  append_bytes(out, std::uint64_t{0});
  (append_field(out, fields), ...);
  const std::uint64_t length = out.size() - at - sizeof length;
  std::memcpy(out.data() + at, &length, sizeof length);
}

// Returns a message in CDR: its header, then doubles.
Bytes message_of(std::int64_t stamp_ns, std::span<const double> numbers) {
  constexpr std::size_t encapsulation = 4;
  Bytes out{std::byte{0}, std::byte{1}, std::byte{0}, std::byte{0}};
  append_bytes(out, std::int32_t(stamp_ns / second));
  append_bytes(out, std::uint32_t(stamp_ns % second));
  append_text(out, std::string_view("imu\0", 4));
  out.resize(encapsulation + aligned(out.size() - encapsulation, sizeof(double)));
  for (const double number : numbers) append_bytes(out, number);
  return out;
}

struct WrittenTopic {
  std::string_view name, type, fields;
};
constexpr std::array<WrittenTopic, 2> written_topics{
    {{"/imu/data", "sensor_msgs/msg/Imu",
      "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
      "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
      "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"},
     {"/imu/temperature", "sensor_msgs/msg/Temperature", "float64 temperature\nfloat64 variance\n"}}};

// Returns a message definition with the types it is made of, as a bag has it (https://mcap.dev/spec/registry#ros2msg).
std::string definition_of(const WrittenTopic& topic) {
  std::string text = fmt::format("std_msgs/Header header\n{}", topic.fields);
  for (const auto& [type, fields] :
       {std::pair("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
        {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
        {"geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"},
        {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"}})
    text += fmt::format("{:=<80}\nMSG: {}\n{}", "", type, fields);
  return text;
}

// Writes zstd chunks with checksums and indexes, and the summary by which readers find them.
class McapWriter {
 public:
  McapWriter(AtomicFile& file, std::size_t topics) : file_(file), counts_(topics), index_(topics) {
    append_bytes(out_, mcap::magic);
    append_record(out_, mcap::header, std::string_view("ros2"), std::string_view("turncal"));
    append_topics();
  }

  Status add(std::uint16_t topic, std::int64_t ns, std::span<const double> numbers) {
    last_ = std::uint64_t(ns);
    if (chunk_.empty()) first_ = last_;
    if (!begin_) begin_ = last_;
    append_bytes(index_[topic], last_);
    append_bytes(index_[topic], std::uint64_t{chunk_.size()});
    append_record(chunk_, mcap::message, topic, std::uint32_t(counts_[topic]++), last_, last_, message_of(ns, numbers));
    constexpr std::size_t enough = std::size_t{1} << 20;
    return chunk_.size() < enough ? Status() : end_chunk();
  }

  Status finish() {
    if (!chunk_.empty()) TRY(end_chunk());
    append_record(out_, mcap::data_end, std::uint32_t{0});
    const std::uint64_t summary = written_ + out_.size();
    append_topics();
    Bytes counts;
    std::uint64_t all = 0;
    for (std::uint16_t topic = 0; topic < std::uint16_t(counts_.size()); ++topic) {
      all += counts_[topic];
      append_bytes(counts, topic);
      append_bytes(counts, counts_[topic]);
    }
    const auto topics = std::uint32_t(counts_.size());
    append_record(out_, mcap::statistics, all, std::uint16_t(topics), topics, std::uint32_t{0}, std::uint32_t{0},
                  chunks_, begin_.value_or(0), last_, length_of(counts), counts);
    append_field(out_, chunk_indexes_);
    append_record(out_, mcap::footer, summary, std::uint64_t{0}, std::uint32_t{0});
    append_bytes(out_, mcap::magic);
    return flush();
  }

 private:
  static std::uint32_t length_of(const Bytes& list) { return std::uint32_t(list.size()); }

  void append_topics() {
    for (std::uint16_t topic = 0; topic < std::uint16_t(counts_.size()); ++topic) {
      const WrittenTopic& row = written_topics[topic];
      const auto schema = std::uint16_t(topic + 1);  // 0 means no schema
      append_record(out_, mcap::schema, schema, row.type, std::string_view("ros2msg"),
                    std::string_view(definition_of(row)));
      append_record(out_, mcap::channel, topic, schema, row.name, std::string_view("cdr"), std::uint32_t{0});
    }
  }

  Status end_chunk() {
    Bytes packed(ZSTD_compressBound(chunk_.size()));
    packed.resize(ZSTD_compress(packed.data(), packed.size(), chunk_.data(), chunk_.size(), ZSTD_CLEVEL_DEFAULT));
    const std::uint64_t at = written_ + out_.size();
    const auto crc = std::uint32_t(crc32_z(0, reinterpret_cast<const Bytef*>(chunk_.data()), chunk_.size()));
    append_record(out_, mcap::chunk, first_, last_, std::uint64_t{chunk_.size()}, crc, std::string_view("zstd"),
                  std::uint64_t{packed.size()}, packed);
    const std::uint64_t end = written_ + out_.size();
    Bytes offsets;
    for (std::uint16_t topic = 0; topic < std::uint16_t(index_.size()); ++topic) {
      append_bytes(offsets, topic);
      append_bytes(offsets, std::uint64_t{written_ + out_.size()});
      append_record(out_, mcap::message_index, topic, length_of(index_[topic]), index_[topic]);
      index_[topic].clear();
    }
    append_record(chunk_indexes_, mcap::chunk_index, first_, last_, at, end - at, length_of(offsets), offsets,
                  std::uint64_t{written_ + out_.size() - end}, std::string_view("zstd"), std::uint64_t{packed.size()},
                  std::uint64_t{chunk_.size()});
    chunk_.clear();
    ++chunks_;
    return flush();
  }

  Status flush() {
    TRY(file_.write(text_of(out_)));
    written_ += out_.size();
    out_.clear();
    return {};
  }

  AtomicFile& file_;
  Bytes out_, chunk_, chunk_indexes_;
  std::vector<std::uint64_t> counts_;  // messages per topic
  std::vector<Bytes> index_;           // of the chunk, per topic: time and place of each message
  std::uint64_t written_ = 0, first_ = 0, last_ = 0;
  std::optional<std::uint64_t> begin_;
  std::uint32_t chunks_ = 0;
};

}  // namespace

Result<BagImu> read_bag(const std::string& path, const std::string& topic, bool skip_bad) {
  Collector collector(path, topic, skip_bad);
  for (const std::string& name : TRY(files_of(path))) {
    const PosixFile file = TRY(PosixFile::open_to_read(name));
    const std::uint64_t size = TRY(file.size());
    const FileKind kind = recognise_file(name);
    if (kind == FileKind::mcap)
      TRY(McapReader(file, size, collector).read());
    else if (kind == FileKind::rosbag1)
      TRY(Rosbag1Reader(file, size, collector).read());
    else if (kind == FileKind::rosbag2)
      TRY(Rosbag2Reader(name, collector).read());
    else if (Status status = expect_file(name, FileKind::rosbag2); true)
      return status ? input_error(name + ": expected an MCAP file, a .db3 of rosbag2 or a .bag of rosbag1")
                    : status.error();
  }
  return collector.finish();
}

Status write_imu_mcap(RecordingSource& source, const SampleColumns& columns, const std::string& path) {
  TRY(check_replaceable(path, mcap::magic));
  AtomicFile file = TRY(AtomicFile::create(path));
  const bool warm = columns.names.size() > 7;
  McapWriter writer(file, warm ? 2 : 1);
  const std::int64_t start_ns = source.info().started_utc_s.value_or(1) * second;  // 0 would mean no stamp
  std::vector<double> row(columns.names.size());
  ImuNumbers numbers{};
  numbers[orientation_w] = 1.0;
  numbers[covariance_places[0]] = -1.0;
  const auto add = [&](std::span<const ImuSample> samples) -> Status {
    for (const ImuSample& sample : samples) {
      columns.fill(sample, row);
      const std::int64_t ns = start_ns + std::llround(1e9 * row[0]);
      if (warm && std::isfinite(row[7])) TRY(writer.add(1, ns, std::array{row[7], 0.0}));
      for (std::size_t k = 0; k < 6; ++k) numbers[imu_places[k]] = row[k + 1];
      for (const std::size_t triad : {1, 2}) numbers[covariance_places[triad]] = sample.flags == 0 ? 0.0 : -1.0;
      TRY(writer.add(0, ns, numbers));
    }
    return {};
  };
  TRY(source.read(add));
  TRY(writer.finish());
  return file.commit();
}

}  // namespace turncal
