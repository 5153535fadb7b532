#include "turntable_drivers/table/table_state.h"

#include "imu_io/base/key_value.h"
#include "imu_io/base/text.h"
#include "tests/test.h"
#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/table/described_turntable.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {
namespace {

AxisStatus at_rest() {
  AxisStatus axis;
  axis.moving = false;
  axis.enabled = axis.homed = axis.remote = axis.in_position = true;
  return axis;
}

TEST(TableState, OfAnAxis) {
  EXPECT_EQ(state_of(AxisStatus()), TableState::not_ready) << "what is unknown";
  AxisStatus axis = at_rest();
  EXPECT_EQ(state_of(axis), TableState::idle);
  axis.in_position = false;
  EXPECT_EQ(state_of(axis), TableState::settling);
  axis.moving = true;
  EXPECT_EQ(state_of(axis), TableState::moving);
  EXPECT_EQ(state_of(axis, true), TableState::stopping);
  axis.homed = false;
  EXPECT_EQ(state_of(axis), TableState::not_ready) << "homing";
  EXPECT_EQ(state_of(axis, true), TableState::stopping) << "a homing that is being stopped";
  axis.limit = true;
  EXPECT_EQ(state_of(axis, true), TableState::fault);
  axis.emergency_stop = true;
  EXPECT_EQ(state_of(axis), TableState::emergency_stop);
  for (bool AxisStatus::*needed : {&AxisStatus::enabled, &AxisStatus::homed, &AxisStatus::remote}) {
    AxisStatus without = at_rest();
    without.*needed = false;
    EXPECT_EQ(state_of(without), TableState::not_ready);
  }
}

TEST(TableState, OfATableIsThatOfItsWorstAxis) {
  std::array<AxisStatus, 3> axes{at_rest(), at_rest(), at_rest()};
  EXPECT_EQ(state_of(axes), TableState::idle);
  axes[1].moving = true;
  EXPECT_EQ(state_of(axes), TableState::moving);
  axes[2].fault = true;
  EXPECT_EQ(state_of(axes), TableState::fault);
  EXPECT_STREQ(to_string(state_of(axes)), "FAULT");
}

// ---- what is remembered of an axis ----

// An axis that was read at this angle and then told to look for its zero.
AxisMemory homing_from(double angle_deg, bool searches = true) {
  AxisMemory axis;
  axis.note(angle_deg, 0.0);
  axis.homing_began(searches);
  return axis;
}

// A drive that has not begun yet still shows the flag of the session before.
TEST(AxisMemory, AHomedFlagThatNothingChangesIsTheOldOne) {
  AxisMemory axis = homing_from(50.0);
  for (int i = 0; i < 100; ++i) {
    axis.note(50.0, 1.0 + i);
    EXPECT_FALSE(axis.judge_homed(true, false)) << "reading " << i;
  }
  EXPECT_FALSE(axis.judge_homed(true, true)) << "it turns";
  axis.note(0.0, 110.0);
  EXPECT_TRUE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, true)) << "a move, later";
}

TEST(AxisMemory, AHomingIsSeenByItsFlagAndByItsAngle) {
  AxisMemory by_flag = homing_from(50.0);
  EXPECT_FALSE(by_flag.judge_homed(false, false));
  EXPECT_TRUE(by_flag.judge_homed(true, false)) << "wherever its zero is";
  AxisMemory by_angle = homing_from(50.0);
  by_angle.note(-120.0, 1.0);
  EXPECT_TRUE(by_angle.judge_homed(true, false)) << "nobody looked while it turned";
}

TEST(AxisMemory, AnAxisAtItsZeroIsBelievedFromTheThirdReadingOn) {
  AxisMemory axis = homing_from(0.3);
  EXPECT_FALSE(axis.judge_homed(true, false));
  EXPECT_FALSE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, false));
  EXPECT_TRUE(axis.judge_homed(true, true)) << "a move, later";
}

TEST(AxisMemory, AnEncoderThatKnowsItsAngleNeedNotTurn) {
  AxisMemory axis = homing_from(50.0, false);
  EXPECT_TRUE(axis.judge_homed(true, false));
}

// ---- sentence ----

// Sentences: published checksums, anchored templates, strict numbers, and the defects of a dialect's text.

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
  const struct {
    const char* pattern;
    std::vector<const char*> fit, others;
  } cases[] = {{"{axis}={position}", {"1=90.0"}, {"1=90.0 ", " 1=90.0", "1=90,0", "1="}},
               {"AS,{position},{rate}", {"AS,1,2"}, {"AS,1,2,3", "AS,,2"}},
               {"0,{*}", {"0, 1, no error"}, {"1, 1"}},
               {"{*}", {""}, {}},
               {"OK", {"OK"}, {"OKOK"}}};
  for (const auto& [pattern, fit, others] : cases) {
    for (const char* text : fit) EXPECT_TRUE(SentenceTemplate::parse(pattern)->match(text)) << pattern << ": " << text;
    for (const char* text : others)
      EXPECT_FALSE(SentenceTemplate::parse(pattern)->match(text)) << pattern << ": " << text;
  }
  EXPECT_EQ(SentenceTemplate::parse("{axis}={position}")->match("1=90.0")->at("position"), "90.0");
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

TEST(DialectFile, StatusWords) {
  DialectStatus bits;
  bits.by_bits = true;
  bits.base = 16;
  bits.mask[std::size_t(DriveBit::in_position)] = 0x80;
  bits.mask[std::size_t(DriveBit::fault)] = 0x8000;
  bits.mask[std::size_t(DriveBit::moving)] = 1;
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

// ---- line source ----

// Where the lines of shipped descriptions come from: every one says it, and docs/tables.md says the same of each file.

std::vector<std::filesystem::path> shipped() {
  std::vector<std::filesystem::path> files;
  for (const char* const folder :
       {"/turntable_drivers/modbus/maps", "/turntable_drivers/ascii/dialects", "/imu_io/frames"})
    for (const auto& entry : std::filesystem::directory_iterator(TURNCAL_SOURCE_DIR + std::string(folder)))
      if (const auto kind = entry.path().extension(); kind == ".map" || kind == ".dialect" || kind == ".frame")
        files.push_back(entry.path());
  std::ranges::sort(files, [](const auto& a, const auto& b) { return a.filename() < b.filename(); });
  return files;
}

bool claims_nothing(const std::string& key) {
  return key == "format" || key == "name" || key == "verified_on_hardware" || key == "commissioned";
}

TEST(LineSource, EveryLineOfAShippedFileHasOne) {
  const auto files = shipped();
  ASSERT_GE(files.size(), 14u);
  for (const auto& path : files) {
    Result<KeyValueFile> file = good(KeyValueFile::read(path));
    const std::vector<LineSource> lines = read_line_sources(*file);
    EXPECT_OK(file->status());
    for (const LineSource& line : lines)
      EXPECT_NE(line.mark.empty(), !claims_nothing(line.key)) << path << ":" << line.line << ": " << line.key;
    for (const std::string& source : file->keys_with_prefix("source."))
      EXPECT_TRUE(std::ranges::any_of(lines, [&](const LineSource& line) { return "source." + line.mark == source; }))
          << path << ": nothing is from " << source;
  }
}

// `| file | sources | guesses |` in docs/tables.md, one row a file, from the file itself.
TEST(LineSource, TheDocumentSaysWhatIsShippedAndGuessed) {
  const std::string document = file_text(TURNCAL_SOURCE_DIR "/docs/tables.md");
  std::string expected;
  for (const auto& path : shipped()) {
    Result<KeyValueFile> file = KeyValueFile::read(path);
    std::string sources, guesses;
    for (const std::string& key : file->keys_with_prefix("source."))
      sources += (sources.empty() ? "" : "; ") + file->text(key);
    for (const LineSource& line : read_line_sources(*file))
      if (line.is_guess()) guesses += (guesses.empty() ? "`" : ", `") + line.key + "`";
    const std::string row =
        "| `" + path.filename().string() + "` | " + sources + " | " + (guesses.empty() ? "nothing" : guesses) + " |";
    if (document.find(row) == std::string::npos) expected += row + "\n";
  }
  EXPECT_EQ(expected, "") << "rows that docs/tables.md must have";
}

TEST(LineSource, MarksAreReadAndAWrongOneIsRefused) {
  Result<KeyValueFile> file =
      good(KeyValueFile::parse("source.m = Maker\na = 1 # [m] page 3\nb = 2 # [guess]\nc = 3\n", "f"));
  const std::vector<LineSource> lines = read_line_sources(*file);
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0].mark, "m");
  EXPECT_TRUE(lines[1].is_guess());
  EXPECT_EQ(lines[1].line, 3);
  EXPECT_EQ(lines[2].mark, "");
  EXPECT_TRUE(file->status().ok());
  for (const std::string mark : {"[n]", "guess", "[]", "from [m]"}) {
    file = KeyValueFile::parse("source.m = Maker\na = 1 # " + mark + "\n", "f");
    read_line_sources(*file);
    ASSERT_FALSE(file->status().ok()) << mark;
  }
  EXPECT_TRUE(fails(file->status(), "f:2: key 'a' = '1': expected [guess], [yours] or a NAME"));
  // Whoever wrote a file without sources may comment as he likes.
  file = KeyValueFile::parse("a = 1 # [deg]\n", "f");
  EXPECT_EQ(read_line_sources(*file)[0].mark, "");
  EXPECT_TRUE(file->status().ok());
}

TEST(LineSource, WhatDecidesAMotion) {
  for (const char* const key : {"write.stop", "write.enable.scope", "bit.fault.mask", "axis.pitch.bit.homed.address",
                                "status2.address", "status.bit.fault", "status.code.1", "home.1", "move.3.expect"})
    EXPECT_TRUE(decides_motion(key)) << key;
  for (const char* const key :
       {"link.baud", "write.setup", "write.clear_fault", "axis.pitch.name", "prepare.1", "axis"})
    EXPECT_FALSE(decides_motion(key)) << key;
}

}  // namespace
}  // namespace turncal
