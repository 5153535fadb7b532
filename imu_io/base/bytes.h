// Little-endian bytes of binary files: functions that append numbers, and a reader that checks every access.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace turncal {

static_assert(std::endian::native == std::endian::little, "files are little-endian and written without swapping");

template <class T>
requires std::is_arithmetic_v<T>
void append_bytes(std::vector<std::byte>& out, T value) {
  const std::size_t place = out.size();
  out.resize(place + sizeof value);
  std::memcpy(out.data() + place, &value, sizeof value);
}

inline void append_bytes(std::vector<std::byte>& out, std::string_view text) {
  const std::size_t place = out.size();
  out.resize(place + text.size());
  if (!text.empty()) std::memcpy(out.data() + place, text.data(), text.size());
}

// Appends the length (u32), then the text.
inline void append_text(std::vector<std::byte>& out, std::string_view text) {
  append_bytes(out, std::uint32_t(text.size()));
  append_bytes(out, text);
}

// Reads a number. REQUIRES: sizeof(T) bytes at `from`.
template <class T>
requires std::is_arithmetic_v<T> T load_bytes(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

// Appends every field of a list. ByteReader has the same call, so one list of fields serves writing and reading.
struct ByteWriter {
  std::vector<std::byte>& out;
  template <class... Numbers>
  void operator()(const Numbers&... numbers) {
    (append_bytes(out, numbers), ...);
  }
};

// Reads from the front. After a read past the end, good() is false and every read returns 0.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> data) : data_(data) {}

  template <class T>
  requires std::is_arithmetic_v<T> T get() {
    const auto bytes = get_bytes(sizeof(T));
    return bytes.empty() ? T{} : load_bytes<T>(bytes.data());
  }
  template <class... Numbers>
  void operator()(Numbers&... numbers) {
    ((numbers = get<Numbers>()), ...);
  }
  // Returns an empty span when fewer bytes are left.
  std::span<const std::byte> get_bytes(std::uint64_t count) {
    if (!good_ || count > data_.size()) {
      good_ = false;
      return {};
    }
    const auto result = data_.first(std::size_t(count));
    data_ = data_.subspan(std::size_t(count));
    return result;
  }
  // Reads what append_text() wrote.
  std::string get_text() {
    const auto bytes = get_bytes(get<std::uint32_t>());
    return bytes.empty() ? std::string() : std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }
  bool good() const { return good_; }
  bool at_end() const { return good_ && data_.empty(); }

 private:
  std::span<const std::byte> data_;
  bool good_ = true;
};

}  // namespace turncal
