// The help of every command, and a calibration as the run made it. What is refused: tests/golden/refused.sh.
#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class CommandLine : public Program {};

// Of `turncal X --help`: what it lists as commands.
std::vector<std::string> listed(const std::string& help) {
  std::vector<std::string> names;
  for (const std::string& line : lines_of(help.substr(0, help.find("Examples:"))))
    if (line.starts_with("  ") && std::islower(static_cast<unsigned char>(line[2])) != 0)
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
  return names;
}

TEST_F(CommandLine, EveryHelpIsGroupedNarrowAndHasTwoExamples) {
  const std::string help = run("--help").out;
  for (const char* group : {"Station:", "Data:", "Analysis:", "Line:", "Records:"})
    EXPECT_SAYS(help, "\n" + std::string(group) + "\n");
  std::vector<Arguments> commands = {{}};
  for (const std::string& name : listed(help)) commands.push_back({name});
  for (const std::string& action : listed(run("records --help").out)) commands.push_back({"records", action});
  ASSERT_GT(commands.size(), 30u);
  for (const Arguments& command : commands) {
    const std::string text = run(command + "--help").out;
    EXPECT_EQ(run(Arguments{"help"} + command).out, text) << command.line();
    const std::size_t examples = text.find("\nExamples:\n  turncal ");
    ASSERT_NE(examples, std::string::npos) << command.line();
    int count = 0;
    for (const std::string& line : lines_of(text.substr(examples + 11)))
      count += line.starts_with("  turncal ") ? 1 : 0;
    EXPECT_EQ(count, 2) << command.line();
    for (const std::string& line : lines_of(text)) EXPECT_LE(line.size(), 100u) << line;
  }
  EXPECT_EQ(run("-V").out, run("--version").out);
}

// An example whose options are not those of its command would say so before it looks for its files.
TEST_F(CommandLine, ExamplesAreUnderstood) {
  int tried = 0;
  for (const std::string& line :
       lines_of(file_text(std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/commands/examples.txt"))) {
    ASSERT_TRUE(line.starts_with("turncal ") && line.size() <= 98) << line;
    if (line.find("--dry-run") != std::string::npos || line.find(" design ") != std::string::npos) continue;
    const ProgramResult result = run(Arguments(line.substr(8)));
    EXPECT_SAYS_NOT(result.err, "--help)") << line;
    ++tried;
  }
  EXPECT_GT(tried, 50);
}

TEST_F(CommandLine, CalibrateGivesWhatTheRunGave) {
  ends(quick_run("demo"), 0);
  ends("calibrate demo --out again", 0);
  const auto values = [&](const std::string& name) {
    std::string kept;
    for (const std::string& line : lines_of(file_text(folder_ / name / "parameters.conf"))) {
      // record.*: what only the run knows.
      if (!line.starts_with("time_utc") && !line.starts_with("checksum") && !line.starts_with("record."))
        kept += line + "\n";
    }
    return kept;
  };
  EXPECT_EQ(values("again"), values("demo"));
}

}  // namespace
}  // namespace turncal
