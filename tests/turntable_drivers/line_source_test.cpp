// Where the lines of shipped descriptions come from: every one says it, and docs/tables.md says the same of each file.
#include "imu_io/base/key_value.h"
#include "tests/test.h"
#include "turntable_drivers/table/table_description.h"

namespace turncal {
namespace {

std::vector<std::filesystem::path> shipped() {
  std::vector<std::filesystem::path> files;
  for (const char* const folder :
       {"/turntable_drivers/modbus/maps", "/turntable_drivers/ascii/dialects", "/imu_io/frames"})
    for (const auto& entry : std::filesystem::directory_iterator(TURNCAL_SOURCE_DIR + std::string(folder)))
      if (const auto kind = entry.path().extension(); kind == ".map" || kind == ".dialect" || kind == ".frame")
        files.push_back(entry.path());
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.filename() < b.filename(); });
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
      EXPECT_TRUE(std::any_of(lines.begin(), lines.end(),
                              [&](const LineSource& line) { return "source." + line.mark == source; }))
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
