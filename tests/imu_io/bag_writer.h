// Writes ROS bags for tests, from the specifications and not from the reader: CDR and ROS 1 messages, MCAP, rosbag2's SQLite file, rosbag1.
#pragma once

#include <bzlib.h>
#include <lz4frame.h>
#include <sqlite3.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

namespace turncal::test {

struct BagMessage {
  std::int64_t ns = 0;
  double gyro[3] = {}, accel[3] = {};
};

// A number as its bytes, the least or the most significant first.
template <class T>
std::string raw(T value, bool big = false) {
  std::string bytes(reinterpret_cast<const char*>(&value), sizeof value);
  if (big) std::ranges::reverse(bytes);
  return bytes;
}
inline std::string text(const std::string& value, bool big = false) {
  return raw(std::uint32_t(value.size()), big) + value;
}

enum class Wire { cdr, cdr_big, xcdr2, ros1 };

// The header of a message, and behind it the doubles, aligned as the wire wants it.
inline std::string message_of(std::int64_t ns, const std::vector<double>& numbers, Wire wire) {
  const bool big = wire == Wire::cdr_big;
  std::string body = wire == Wire::ros1 ? raw(std::uint32_t{7}) : "";
  body += raw(std::int32_t(ns / 1'000'000'000), big) + raw(std::uint32_t(ns % 1'000'000'000), big);
  body += text(wire == Wire::ros1 ? "imu" : std::string("imu\0", 4), big);
  const std::size_t align = wire == Wire::ros1 ? 1 : wire == Wire::xcdr2 ? 4 : 8;
  while (body.size() % align != 0) body += '\0';
  for (const double number : numbers) body += raw(number, big);
  const char kind = wire == Wire::cdr_big ? 0 : wire == Wire::cdr ? 1 : 7;
  return wire == Wire::ros1 ? body : std::string{'\0', kind, '\0', '\0'} + body;
}
inline std::string imu_message(const BagMessage& m, Wire wire = Wire::cdr, double covariance = 0.0) {
  std::vector<double> numbers(37, 0.0);
  numbers[3] = 1.0;
  for (std::size_t k = 0; k < 3; ++k) numbers[13 + k] = m.gyro[k], numbers[25 + k] = m.accel[k];
  numbers[16] = covariance;
  return message_of(m.ns, numbers, wire);
}

struct BagTopic {
  std::string name = "/imu/data", type = "sensor_msgs/msg/Imu";
  std::vector<std::pair<std::int64_t, std::string>> messages;  // when recorded, and what
};

inline std::string packed(const std::string& data, const std::string& compression) {
  std::string out(ZSTD_compressBound(data.size()) + LZ4F_compressFrameBound(data.size(), nullptr), '\0');
  if (compression == "zstd")
    out.resize(ZSTD_compress(out.data(), out.size(), data.data(), data.size(), 1));
  else if (compression == "lz4")
    out.resize(LZ4F_compressFrame(out.data(), out.size(), data.data(), data.size(), nullptr));
  else if (auto size = unsigned(out.size()); compression == "bz2")
    BZ2_bzBuffToBuffCompress(out.data(), &size, const_cast<char*>(data.data()), unsigned(data.size()), 9, 0, 0),
        out.resize(size);
  else
    return data;
  return out;
}

inline std::string mcap_record(int op, const std::string& content) {
  return std::string(1, char(op)) + raw(std::uint64_t{content.size()}) + content;
}
// compression: "none" writes messages outside of chunks.
inline std::string mcap(const std::vector<BagTopic>& topics, const std::string& compression,
                        std::size_t in_chunk = 100) {
  std::string file = "\x89MCAP0\r\n" + mcap_record(1, text("ros2") + text("test"));
  std::string pending;
  const auto flush = [&] {
    const std::string in = packed(pending, compression);
    const auto crc = std::uint32_t(crc32(0, reinterpret_cast<const Bytef*>(pending.data()), unsigned(pending.size())));
    if (compression == "none")
      file += pending;
    else
      file += mcap_record(6, raw(std::uint64_t{0}) + raw(std::uint64_t{0}) + raw(std::uint64_t{pending.size()}) +
                                 raw(crc) + text(compression) + raw(std::uint64_t{in.size()}) + in) +
              mcap_record(7, "index");
    pending.clear();
  };
  std::uint16_t id = 0;
  for (const BagTopic& topic : topics) {
    ++id;
    pending += mcap_record(3, raw(id) + text(topic.type) + text("ros2msg") + text(""));
    pending += mcap_record(4, raw(id) + raw(id) + text(topic.name) + text("cdr") + raw(std::uint32_t{0}));
    std::size_t count = 0;
    for (const auto& [ns, message] : topic.messages) {
      pending += mcap_record(5, raw(id) + raw(std::uint32_t{0}) + raw(ns) + raw(ns) + message);
      if (++count % in_chunk == 0) flush();
    }
  }
  flush();
  return file + mcap_record(15, raw(std::uint32_t{0})) + mcap_record(2, std::string(20, '\0')) + "\x89MCAP0\r\n";
}

inline void db3(const std::string& path, const std::vector<BagTopic>& topics, const std::string& compression = "") {
  sqlite3* handle = nullptr;
  sqlite3_open(path.c_str(), &handle);
  sqlite3_exec(handle,
               "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
               "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT);"
               "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
               "data BLOB NOT NULL); BEGIN",
               nullptr, nullptr, nullptr);
  int id = 0;
  for (const BagTopic& topic : topics) {
    const std::string insert = "INSERT INTO topics VALUES(" + std::to_string(++id) + ", '" + topic.name + "', '" +
                               topic.type + "', 'cdr', '')";
    sqlite3_exec(handle, insert.c_str(), nullptr, nullptr, nullptr);
    sqlite3_stmt* row = nullptr;
    sqlite3_prepare_v2(handle, "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", -1, &row, nullptr);
    for (const auto& [ns, message] : topic.messages) {
      const std::string data = packed(message, compression);
      sqlite3_bind_int(row, 1, id);
      sqlite3_bind_int64(row, 2, ns);
      sqlite3_bind_blob(row, 3, data.data(), int(data.size()), SQLITE_TRANSIENT);
      sqlite3_step(row);
      sqlite3_reset(row);
    }
    sqlite3_finalize(row);
  }
  sqlite3_exec(handle, "COMMIT", nullptr, nullptr, nullptr);
  sqlite3_close(handle);
}

inline std::string bag1(const BagTopic& topic, const std::string& compression) {
  const auto record = [](const std::vector<std::string>& fields, const std::string& data) {
    std::string header;
    for (const std::string& field : fields) header += text(field);
    return text(header) + text(data);
  };
  const std::string conn = "conn=" + raw(std::uint32_t{3});
  std::string inner = record({"op=\x07", conn, "topic=" + topic.name}, text("type=sensor_msgs/Imu") + text("md5sum=x"));
  for (const auto& [ns, message] : topic.messages) {
    const std::string time = raw(std::uint32_t(ns / 1'000'000'000)) + raw(std::uint32_t(ns % 1'000'000'000));
    inner += record({"op=\x02", conn, "time=" + time}, message);
  }
  return "#ROSBAG V2.0\n" + record({"op=\x03", "chunk_count=" + raw(std::uint32_t{1})}, std::string(100, ' ')) +
         record({"op=\x05", "compression=" + compression, "size=" + raw(std::uint32_t(inner.size()))},
                packed(inner, compression));
}

}  // namespace turncal::test
