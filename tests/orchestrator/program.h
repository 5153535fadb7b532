// For tests: the built program as a black box, in a folder of its own.
#pragma once

#include <sys/wait.h>
#include "tests/test.h"

namespace turncal {

inline const std::string short_demo = std::string(TURNCAL_SOURCE_DIR) + "/sequences/short_demo.seq";  // ten minutes

// What every station of a dry run says.
inline const std::string station_head =
    "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = mock\nimu.driver = rig\n";

// A station with the twin's map and a unit on a serial line; for real unless `more` says otherwise.
inline std::string live_station(const std::string& more = "", const std::string& device = "none") {
  return "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = modbus\n"
         "table.map = " TURNCAL_SOURCE_DIR
         "/orchestrator/stations/twin.map\nimu.driver = serial\nimu.frame = laser_gyro\nimu.device = " +
         device + "\n" + more;
}

// Of a command line; of a text, the words between its blanks.
struct Arguments : std::vector<std::string> {
  using std::vector<std::string>::vector;
  Arguments(std::vector<std::string> words) : std::vector<std::string>(std::move(words)) {}
  Arguments(const char* line) : Arguments(std::string(line)) {}
  Arguments(const std::string& line) {
    std::istringstream text(line);
    for (std::string word; text >> word;) push_back(word);
  }
  std::string line() const {
    std::string text = "turncal";
    for (const std::string& word : *this) text += " " + word;
    return text;
  }
};
inline Arguments operator+(Arguments arguments, const Arguments& more) {
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}
inline Arguments operator+(const char* line, const Arguments& more) { return Arguments(line) + more; }
inline Arguments operator+(Arguments arguments, const char* line) { return std::move(arguments) + Arguments(line); }

inline std::vector<std::string> lines_of(const std::string& text, char end = '\n') {
  std::vector<std::string> lines;
  std::istringstream all(text);
  for (std::string line; std::getline(all, line, end);) lines.push_back(line);
  return lines;
}

// Of lines "key = value"; those without a value are kept.
inline std::map<std::string, std::string> entries(const std::string& text) {
  std::map<std::string, std::string> result;
  for (const std::string& line : lines_of(text)) {
    const std::size_t equals = line.find(" =");
    if (line.starts_with("#") || equals == std::string::npos) continue;
    result[line.substr(0, equals)] = line.size() > equals + 3 ? line.substr(equals + 3) : "";
  }
  return result;
}

struct ProgramResult {
  int code = -1;
  std::string out;
  std::string err;
  long err_lines() const { return std::ranges::count(err, '\n'); }
};

class Program : public testing::Test {
 protected:
  void SetUp() override {
    // In memory where there is such a file system: runs sync hundreds of times.
    const bool in_memory = ::access("/dev/shm", W_OK) == 0;
    std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
    std::ranges::replace(name, '/', '_');
    folder_ = (in_memory ? std::filesystem::path("/dev/shm") : std::filesystem::temp_directory_path()) /
              ("turncal_program_" + std::to_string(::getpid()) + "_" + name);
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override {
    std::filesystem::remove_all(folder_);
    std::filesystem::remove(folder_.string() + ".count");
  }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return path(name);
  }
  // Every file and folder there is, relative to the test's own; not the lock of a folder, which a program that was killed leaves and the
  // next one takes away.
  std::set<std::string> everything() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_))
      if (entry.path().filename() != ".lock") names.insert(std::filesystem::relative(entry.path(), folder_).string());
    return names;
  }

  // Starts the program in the test's folder; its output goes to files outside of it.
  pid_t start(const Arguments& arguments) const {
    const pid_t pid = ::fork();
    if (pid != 0) return pid;
    for (const auto& [descriptor, name] : {std::pair{1, ".out"}, std::pair{2, ".err"}}) {
      const int fd = ::open((folder_.string() + name).c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
      ::dup2(fd, descriptor);
    }
    become_program(arguments);
  }
  // Of a child: from here on it is the program, in the test's folder.
  [[noreturn]] void become_program(const Arguments& arguments) const {
    if (::chdir(folder_.c_str()) != 0) ::_exit(99);
    std::vector<char*> argv = {const_cast<char*>(TURNCAL_BINARY)};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    ::execv(TURNCAL_BINARY, argv.data());
    ::_exit(98);
  }
  ProgramResult finish(pid_t pid) const {
    int status = 0;
    ::waitpid(pid, &status, 0);
    ProgramResult result;
    result.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1000 - WTERMSIG(status);
    result.out = file_text(folder_.string() + ".out");
    result.err = file_text(folder_.string() + ".err");
    std::filesystem::remove(folder_.string() + ".out");
    std::filesystem::remove(folder_.string() + ".err");
    return result;
  }
  ProgramResult run(const Arguments& arguments) const { return finish(start(arguments)); }
  // With this exit code and, where `text` is given, one line on stderr that holds it.
  ProgramResult ends(const Arguments& arguments, int code, const std::optional<std::string>& text = {}) const {
    const ProgramResult result = run(arguments);
    EXPECT_EQ(result.code, code) << arguments.line() << '\n' << result.err << result.out;
    if (!text) return result;
    EXPECT_EQ(result.err_lines(), 1) << arguments.line() << '\n' << result.err;
    EXPECT_SAYS(result.err, *text) << arguments.line();
    return result;
  }
  // A dry run of the short sequence.
  static Arguments dry_run(const std::string& out, const Arguments& more = {}, const std::string& unit = "SN1") {
    return Arguments{"run", "--dry-run", "--unit", unit, "--out", out, "--sequence", short_demo} + more;
  }
  // What this run leaves in the folder `out`: made once for all tests, and copied. It names its files by their names in the test's folder.
  void made(const std::string& out, const Arguments& run_of, int code = 0) const {
    static std::map<std::string, TemporaryFolder> all;
    std::string key = run_of.line();
    for (const std::string& word : run_of)
      if (std::filesystem::is_regular_file(folder_ / word)) key += '\n' + file_text(folder_ / word);
    const auto [kept, first] = all.try_emplace(key);
    if (first) ends(run_of, code);
    const std::filesystem::path here = folder_ / out, there = kept->second / "made";
    std::filesystem::create_directories(here.parent_path());
    std::filesystem::copy(first ? here : there, first ? there : here, std::filesystem::copy_options::recursive);
  }
  // Of the short sequence the steps before `step`. Those before 5 determine everything.
  std::string first_steps(const std::string& step) const {
    const std::string whole = file_text(short_demo);
    write("first_steps.seq", whole.substr(0, whole.find("step " + step)));
    return "first_steps.seq";
  }
  // A dry run of two steps, which determine everything, with every kind of write that fourteen have.
  Arguments quick_run(const std::string& out, const Arguments& more = {}, const std::string& unit = "SN1") const {
    write(
        "quick.seq",
        "format = 1\nname = quick\nrate_degps = 30\nacceleration_degps2 = 60\n"
        "step 1\n  initial H -90 P 0 R 0\n  align 1000\n  rotate P +180\n  dwell 1000\n  rotate P -180\n  dwell 1000\n"
        "  rotate P -180\n  dwell 1000\n  rotate P +180\n"
        "step 2\n  initial H -90 P 0 R -90\n  align 1000\n  rotate P +90\n  dwell 1000\n  rotate P -90\n  dwell 1000\n"
        "  rotate P -90\n  dwell 1000\n  rotate P +90\n");
    return Arguments{"run", "--dry-run", "--unit", unit, "--out", out, "--sequence", "quick.seq"} + more;
  }
  // With the library in front that strikes at call `point` (0: counts them into FOLDER.count); mode: kill, power or full.
  ProgramResult run_struck(const Arguments& arguments, long point, const char* mode) const {
    ::setenv("LD_PRELOAD", TURNCAL_FAULT_POINTS, 1);
    ::setenv("TURNCAL_FAULT_POINT", std::to_string(point).c_str(), 1);
    ::setenv("TURNCAL_FAULT_MODE", mode, 1);
    ::setenv("TURNCAL_FAULT_COUNT", (folder_.string() + ".count").c_str(), 1);
    const pid_t pid = start(arguments);
    for (const char* name : {"LD_PRELOAD", "TURNCAL_FAULT_POINT", "TURNCAL_FAULT_MODE", "TURNCAL_FAULT_COUNT"})
      ::unsetenv(name);
    return finish(pid);
  }

  // With a copy of the folder as it is left by a kill (k) or a power cut (p) at each of these calls: FOLDER.12, and FOLDER.12/said.
  ProgramResult run_copied(const Arguments& arguments, const std::string& folder,
                           const std::map<long, char>& points) const {
    std::string copies;
    for (const auto& [point, how] : points) copies += " " + std::to_string(point) + how;
    ::setenv("TURNCAL_FAULT_FOLDER", (std::filesystem::canonical(folder_) / folder).c_str(), 1);
    ::setenv("TURNCAL_FAULT_COPIES", copies.c_str(), 1);
    const ProgramResult result = run_struck(arguments, 0, "");
    for (const char* name : {"TURNCAL_FAULT_FOLDER", "TURNCAL_FAULT_COPIES"}) ::unsetenv(name);
    return result;
  }
  // The copy in the folder's place; false: there is none.
  bool take_copy(const std::string& folder, long point) const {
    const std::filesystem::path copy = path(folder + "." + std::to_string(point));
    if (!std::filesystem::exists(copy)) return false;
    std::filesystem::remove_all(folder_ / folder);
    std::filesystem::rename(copy, folder_ / folder);
    return true;
  }
  // Every file of a folder, by its name and its bytes: where two copies are the same, so is what is made of them.
  std::size_t state_of(const std::string& folder) const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_ / folder))
      if (entry.is_regular_file() && entry.path().filename() != "said") files[entry.path()] = file_text(entry.path());
    std::string all;
    for (const auto& [name, text] : files) all += name + '\n' + std::to_string(text.size()) + '\n' + text;
    return std::hash<std::string>()(all);
  }
  // The run, killed at these of its calls (below 1: a share of all; below 0: before the last) and taken up: its exit code, parameters and
  // recording each time. `out`: where it records; `step`: copies are made so many calls apart.
  ProgramResult expect_same_after_kills(const Arguments& begin, const std::string& out,
                                        const std::vector<double>& calls, int code = 0, long step = 4) const {
    const std::string folder = out.substr(0, out.find('/'));
    std::map<long, char> kills;
    for (long call = step; call < 10'000; call += step) kills[call] = 'k';
    ProgramResult whole = run_copied(begin, folder, kills);
    EXPECT_EQ(whole.code, code) << whole.err;
    std::map<std::string, std::string> made;
    for (const char* name : {"parameters.conf", "recording.tcr"}) made[name] = file_text(folder_ / out / name);
    const long all = points_struck();
    const std::filesystem::path here = folder_ / folder, aside = path(folder + ".whole");
    std::filesystem::rename(here, aside);
    std::set<std::size_t> states;
    for (const double call : calls) {
      const double wanted = call < 0.0 ? double(all) + call : call < 1.0 ? call * double(all) : call;
      const long point = std::lround(wanted) / step * step;
      SCOPED_TRACE(point);
      EXPECT_TRUE(take_copy(folder, point));
      if (!states.insert(state_of(folder)).second) continue;
      EXPECT_EQ(run({"resume", out}).code, code);
      for (const auto& [name, bytes] : made) EXPECT_EQ(file_text(folder_ / out / name), bytes) << name;
    }
    std::filesystem::remove_all(here);
    std::filesystem::rename(aside, here);
    return whole;
  }

  // How many calls there were to strike at.
  long points_struck() const { return std::stol(file_text(folder_.string() + ".count")); }
  long count_points(const Arguments& arguments, int code = 0) const {
    EXPECT_EQ(run_struck(arguments, 0, "").code, code);
    return points_struck();
  }

  // Exit code, exactly one line on stderr that holds `text`, and not a file more than before.
  void expect_refused(const Arguments& arguments, const std::string& text, int code = 1) const {
    const std::set<std::string> before = everything();
    ends(arguments, code, text);
    EXPECT_EQ(everything(), before) << arguments.line() << ": left something behind";
  }

  std::filesystem::path folder_;
};

}  // namespace turncal
