#include "imu_io/frames/frame_keys.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>

#include "imu_io/base/format_number.h"
#include "imu_io/base/text_pieces.h"

namespace turncal {
namespace {

constexpr auto last_offset = static_cast<double>(longest_frame - 1);

}  // namespace

std::string FrameKeys::name(const std::string& key) const {
  if (!variant_.empty() && file_.has(variant_ + "." + key)) return variant_ + "." + key;
  return key;
}

std::uint64_t FrameKeys::bits(const std::string& key, std::optional<std::uint64_t> otherwise) {
  const std::string at = name(key);
  if (otherwise && !file_.has(at)) return *otherwise;
  const std::string text = file_.text(at);
  const bool hex = text.starts_with("0x") || text.starts_with("0X");
  const char* const begin = text.data() + (hex ? 2 : 0);
  const char* const end = text.data() + text.size();
  std::uint64_t value = 0;
  const auto result = std::from_chars(begin, end, value, hex ? 16 : 10);
  if (result.ec != std::errc{} || result.ptr != end) {
    file_.reject(at, "a whole number, 0x before hexadecimal, at most 64 bits");
  }
  return value;
}

std::vector<std::byte> FrameKeys::bytes(const std::string& key) {
  std::vector<std::byte> result;
  const std::string text = file_.text_or(name(key), "");
  for (const std::string_view part : split(text, ' ')) {
    if (part.empty()) continue;
    unsigned value = 0;
    const auto got = std::from_chars(part.data(), part.data() + part.size(), value, 16);
    if (got.ec != std::errc{} || got.ptr != part.data() + part.size() || part.size() != 2 || result.size() >= 16) {
      file_.reject(name(key), "at most 16 bytes of two hexadecimal digits, with blanks between");
      return {};
    }
    result.push_back(static_cast<std::byte>(value));
  }
  return result;
}

FieldForm FrameKeys::form(const std::string& prefix, std::string_view default_type) {
  FieldForm form;
  std::string type = file_.one_of_or(name(prefix + ".type"), default_type,
                                     {"u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32", "u64", "i64", "f32", "f64",
                                      "sm8", "sm16", "sm24", "sm32"});
  if (type.empty()) type = default_type;  // refused already
  form.type = type[0] == 'u'   ? NumberType::unsigned_integer
              : type[0] == 'i' ? NumberType::signed_integer
              : type[0] == 's' ? NumberType::sign_magnitude
                               : NumberType::floating;
  form.bytes = parse_integer<int>(std::string_view(type).substr(type[0] == 's' ? 2 : 1)).value_or(8) / 8;
  const std::string order_key = has(prefix + ".order") ? name(prefix + ".order") : name("order");
  form.big_endian = file_.one_of_or(order_key, "little", {"little", "big"}) == "big";
  const std::string words_key = has(prefix + ".word_order") ? name(prefix + ".word_order") : name("word_order");
  form.swap_words = file_.one_of_or(words_key, "same", {"same", "swapped"}) == "swapped" && form.bytes >= 4;
  form.mask = bits(prefix + ".mask", ~std::uint64_t{0});
  const bool floating = form.type == NumberType::floating;
  const std::uint64_t room = form.bytes == 8 ? ~std::uint64_t{0} : (std::uint64_t{1} << (8 * form.bytes)) - 1;
  const std::uint64_t left = form.mask & room;
  if (left == 0 || (floating && left != room)) {
    file_.reject(name(prefix + ".mask"),
                 floating ? "no mask on a floating field" : "a mask that leaves something of the field");
    form.mask = ~std::uint64_t{0};
  } else if (const std::uint64_t run = left >> std::countr_zero(left); (run & (run + 1)) != 0) {
    file_.reject(name(prefix + ".mask"), "a mask of neighbouring bits");
    form.mask = ~std::uint64_t{0};
  }
  return form;
}

std::vector<FrameField> FrameKeys::fields(const std::string& prefix, std::string_view default_type,
                                          std::size_t wanted) {
  return places(prefix + ".offset", form(prefix, default_type), wanted);
}

std::vector<FrameField> FrameKeys::places(const std::string& key, const FieldForm& shape, std::size_t wanted) {
  const std::string at = name(key);
  const std::vector<double> offsets = file_.numbers(at, 0, between(0.0, last_offset));
  std::vector<FrameField> result;
  const auto whole = [](double x) { return x >= 0.0 && x == std::floor(x); };
  if (!std::all_of(offsets.begin(), offsets.end(), whole) || offsets.empty() || offsets.size() > 16 ||
      (wanted != 0 && offsets.size() != 1 && offsets.size() != wanted)) {
    file_.reject(at, wanted > 1 ? "1 or " + std::to_string(wanted) + " whole byte offsets" : "a whole byte offset");
    result.resize(std::max<std::size_t>(wanted, 1), FrameField{0, shape});
    return result;
  }
  for (const double offset : offsets) result.push_back({static_cast<std::size_t>(offset), shape});
  while (result.size() < wanted) {
    result.push_back({result.back().offset + static_cast<std::size_t>(shape.bytes), shape});
  }
  return result;
}

std::array<double, 3> FrameKeys::three(const std::string& key, double otherwise) {
  const std::vector<double> given = file_.numbers_or(name(key), {otherwise});
  if (given.size() == 1) return {given[0], given[0], given[0]};
  if (given.size() == 3) return {given[0], given[1], given[2]};
  file_.reject(name(key), "one or three numbers");
  return {otherwise, otherwise, otherwise};
}

}  // namespace turncal
