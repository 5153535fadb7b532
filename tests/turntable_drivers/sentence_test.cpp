// Sentences: published checksums, anchored templates, strict numbers, and the defects of a dialect's text.
#include "turntable_drivers/ascii/sentence.h"
#include "imu_io/base/text_pieces.h"

#include "tests/test.h"
#include "turntable_drivers/ascii/dialect.h"

namespace turncal {
namespace {

// The four sentences of the protocol that are known to the letter.
TEST(Sentence, PublishedChecksums) {
  EXPECT_EQ(check_digits("MNREM,1", SentenceCheck::sum8), "DC");
  EXPECT_EQ(check_digits("ASREM,OK", SentenceCheck::sum8), "3E");
  EXPECT_EQ(check_digits("MNSTS,1", SentenceCheck::sum8), "F2");
  EXPECT_EQ(check_digits("MNSTP,1", SentenceCheck::sum8), "EF");
  // NMEA 0183's usual example.
  EXPECT_EQ(check_digits("GPGLL,5300.97914,N,00259.98174,E,125926,A", SentenceCheck::exclusive_or), "28");
}

TEST(Sentence, TemplatesAreAnchored) {
  const auto matched = [](const char* pattern, const char* text) {
    return SentenceTemplate::parse(pattern)->match(text).has_value();
  };
  EXPECT_TRUE(matched("{axis}={position}", "1=90.0"));
  EXPECT_EQ(SentenceTemplate::parse("{axis}={position}")->match("1=90.0")->at("position"), "90.0");
  EXPECT_FALSE(matched("{axis}={position}", "1=90.0 "));
  EXPECT_FALSE(matched("{axis}={position}", " 1=90.0"));
  EXPECT_FALSE(matched("{axis}={position}", "1=90,0")) << "no commas in a value";
  EXPECT_FALSE(matched("{axis}={position}", "1="));
  EXPECT_FALSE(matched("AS,{position},{rate}", "AS,1,2,3"));
  EXPECT_FALSE(matched("AS,{position},{rate}", "AS,,2"));
  EXPECT_TRUE(matched("0,{*}", "0, 1, no error"));
  EXPECT_TRUE(matched("{*}", ""));
  EXPECT_TRUE(matched("OK", "OK"));
  EXPECT_FALSE(matched("OK", "OKOK"));
  for (const char* const bad : {"{", "}", "a{}b", "{a}{b}", "{a{b}}", "x}"})
    EXPECT_FALSE(SentenceTemplate::parse(bad)) << bad;
}

TEST(Sentence, Numbers) {
  EXPECT_EQ(device_number("+12.5"), 12.5);
  EXPECT_EQ(device_number(" -0.5 "), -0.5);
  EXPECT_EQ(device_number("1e-3"), 0.001);
  for (const char* const bad : {"", "+", "+-1", "nan", "NaN", "inf", "1.2.3", "1,2", "12a", "0x10", "1e999", "--1"})
    EXPECT_FALSE(device_number(bad)) << bad;
}

TEST(Sentence, Escapes) {
  EXPECT_EQ(unescaped("\\r\\n"), "\r\n");
  EXPECT_FALSE(unescaped("\\x"));
  EXPECT_FALSE(unescaped("a\\"));
  EXPECT_EQ(visible("a\r\n\x01"), "a\\r\\n?");
}

const std::string minimal =
    "format = 1\nname = x\nlink.kind = serial\naxis.heading.name = 1\naxis.pitch.name = 2\naxis.roll.name = 3\n"
    "home.1 = H {axis}\nmove.1 = M {axis} {position} {rate}\nstatus.1 = S {axis}\nstatus.1.expect = {position} "
    "{status}\n"
    "stop.1 = X {axis}\nabort.1 = O {axis}\nstatus.kind = codes\nstatus.code.1 = in_position\nstatus.code.0 = none\n";

std::string error_of(const std::string& what, const std::string& with) {
  const Result<Dialect> dialect = parse_dialect(replaced(minimal, what, with), "my.dialect");
  return dialect.ok() ? "accepted" : dialect.error().message;
}

void refused(const std::string& what, const std::string& with, const char* said) {
  EXPECT_SAYS(error_of(what, with), said) << what << ": " << with;
}

TEST(DialectFile, DefectsAreNamed) {
  EXPECT_EQ(error_of("", ""), "accepted");
  refused("stop.1 = X {axis}\n", "", "'stop.1' is missing");
  refused("{position} {status}", "{status}", "key 'status.1'");
  refused("M {axis} {position}", "M {axis} {angle}", "expected a sentence with");
  refused("M {axis} {position}", "M {axis}{position}", "expected a sentence with");
  refused("status.code.1 = in_position", "status.code.1 = moving", "never has");
  refused("status.code.1 = in_position", "status.code.1 = arrived", "my.dialect:14");
  refused("", "link.terminator_in = \\q\n", "\\r \\n");
  EXPECT_SAYS(error_of("", "move.3 = Y\n"), "move.3") << "a gap in the numbering";
  refused("", "link.bauds = 9600\n", "link.bauds");
}

TEST(DialectFile, StatusWords) {
  DialectStatus bits;
  bits.by_bits = true;
  bits.base = 16;
  bits.mask[static_cast<std::size_t>(DriveBit::in_position)] = 0x80;
  bits.mask[static_cast<std::size_t>(DriveBit::fault)] = 0x8000;
  bits.mask[static_cast<std::size_t>(DriveBit::moving)] = 1;
  EXPECT_TRUE(*flags_of(bits, "80")[DriveBit::in_position]);
  EXPECT_TRUE(*flags_of(bits, "8080")[DriveBit::fault]);
  EXPECT_FALSE(flags_of(bits, "80")[DriveBit::homed].has_value());
  for (const char* const bad : {"", "8g", "-1", "1FFFFFFFF"}) {
    const AxisReading flags = flags_of(bits, bad);
    EXPECT_FALSE(flags.known) << bad;
    EXPECT_FALSE(*flags[DriveBit::in_position]);
    EXPECT_TRUE(*flags[DriveBit::moving]);
  }
}

}  // namespace
}  // namespace turncal
