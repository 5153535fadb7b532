// A run that is killed, cut off from power or stopped by a full disk goes on and ends with the same bytes.
#include "tests/orchestrator/program.h"

#include <regex>

#include "orchestrator/records/journal.h"
#include "orchestrator/records/results_database.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

// A station that judges, keeps a database and a store: everything that a run writes.
const std::string station_text = station_head +
                                 "motion.settle_s = 0.5\nlimit.residual_max = 2\nlimit.N01.sigma_max = 1\n"
                                 "record.database = results.db\nrecord.store = store\n";

class Resume : public Program {
 protected:
  void make_reference() {
    const std::string station = write("reference/mock.station", station_text);
    ASSERT_EQ(run_struck(begin("reference/out", station), 0, "").code, 0);
    long unsynced = -1;
    std::istringstream(file_text(folder_.string() + ".count")) >> points_ >> unsynced;
    EXPECT_EQ(unsynced, 0) << "something was done while a record of the journal was not on disk";
    ASSERT_GT(points_, 250);
    for (const char* name : {"parameters.conf", "recording.tcr", "truth.conf"}) {
      reference_[name] = file_text(folder_ / "reference/out" / name);
      ASSERT_FALSE(reference_[name].empty()) << name;
    }
    reference_dwells_ = dwells(folder_ / "reference/out");
    ASSERT_EQ(reference_dwells_.size(), 8u);
  }

  Arguments begin(const std::string& out, const std::string& station) const {
    return quick_run(out, {"--station", station});
  }
  // Items of the plan whose dwell is in the journal, in order.
  static std::vector<int> dwells(const fs::path& folder) {
    std::vector<int> items;
    const Result<std::string> text = journal_as_text((folder / journal_name).string());
    if (!text) return items;
    static const std::regex dwell("dwell      item = ([0-9]+)");
    for (std::sregex_iterator it(text->begin(), text->end(), dwell), end; it != end; ++it)
      items.push_back(std::stoi((*it)[1]));
    return items;
  }

  // Resumes (or begins anew where nothing was begun) and compares everything with the run that was not interrupted.
  void expect_same_end(const std::string& folder, const std::string& station, const std::string& said) const {
    const fs::path out = folder_ / folder / "out";
    const bool said_pass = said.find("verdict     pass") != std::string::npos;
    const std::vector<int> before = dwells(out);
    const bool begun = fs::exists(out / journal_name);
    if (begun) {
      const Result<JournalContents> journal = good(read_journal((out / journal_name).string()));
      ASSERT_TRUE(!said_pass || !journal->verdicts.empty()) << "PASS was said before it was durable";
    } else {
      ASSERT_FALSE(said_pass);
    }

    ends(begun ? std::vector<std::string>{"resume", folder + "/out"} : begin(folder + "/out", station), 0);
    for (const auto& [name, bytes] : reference_) ASSERT_EQ(file_text(out / name), bytes) << name;
    const std::vector<int> after = dwells(out);
    ASSERT_EQ(after, reference_dwells_) << "a dwell was lost, or one that was complete was done again";
    ASSERT_TRUE(std::equal(before.begin(), before.end(), after.begin()));
    const Result<ResultsDatabase> database =
        good(ResultsDatabase::open_to_read((folder_ / folder / "results.db").string()));
    ASSERT_EQ(database->list({.unit = "SN1"}, "N01")->size(), 1u);
    ASSERT_EQ(file_text(folder_ / folder / "store/simulated/SN1/parameters.conf"), reference_.at("parameters.conf"));
    ASSERT_TRUE(fs::exists(folder_ / folder / "store/simulated/SN1/versions/0001.conf"));
    ASSERT_FALSE(fs::exists(folder_ / folder / "store/simulated/SN1/versions/0002.conf"));
    ASSERT_FALSE(fs::exists(folder_ / folder / "store/SN1")) << "a production file from simulated data";
  }

  int copies_ = 0;
  long points_ = 0;
  std::map<std::string, std::string> reference_;
  std::vector<int> reference_dwells_;
};

// At every call, as a kill and as a power cut in turn; a folder that was seen before ends as it did.
TEST_F(Resume, AfterAKillOrAPowerCutAtAnyWriteOrSync) {
  make_reference();
  const std::string station = write("struck/mock.station", station_text);
  std::map<long, char> points;
  for (long point = 1; point <= points_; ++point) points[point] = "kp"[point / 2 % 2];
  ASSERT_EQ(run_copied(begin("struck/out", station), "struck", points).code, 0);
  std::set<std::pair<std::size_t, bool>> states;  // of the folder, and whether PASS was said
  for (const auto& [point, how] : points) {
    SCOPED_TRACE(std::to_string(point) + how);
    ASSERT_TRUE(take_copy("struck", point));
    const std::string said = file_text(folder_ / "struck/said");
    const bool passed = said.find("verdict     pass") != std::string::npos;
    if (states.insert({state_of("struck"), passed}).second) expect_same_end("struck", station, said);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(states.size(), 100u);
}

TEST_F(Resume, DiskFullAtAnyWriteStopsTheRunAndItGoesOn) {
  make_reference();
  for (long point = 1; point <= points_ && !HasFatalFailure(); point += 13) {
    SCOPED_TRACE("full from call " + std::to_string(point));
    const std::string station = write("full/mock.station", station_text);
    const ProgramResult first = run_struck(begin("full/out", station), point, "full");
    if (first.code == 0) {  // what failed was the log's last line, or nothing: then all the rest is there
      ASSERT_EQ(dwells(folder_ / "full/out"), reference_dwells_);
    } else {
      ASSERT_EQ(first.code, 50) << first.err;
      ASSERT_EQ(first.err_lines(), 1) << first.err;
      const bool named =
          first.err.find("No space left") != std::string::npos || first.err.find("disk is full") != std::string::npos;
      ASSERT_TRUE(named) << first.err;
    }
    expect_same_end("full", station, first.out);
    fs::remove_all(folder_ / "full");
  }
}

// Devices of another kind than those the recording was made with.
TEST_F(Resume, SimulatedAndRealDataAreNeverOneRecording) {
  RecordingInfo info;
  info.latitude_deg = 29.53;
  info.gravity_mps2 = 9.7914;
  info.unit_serial = "SN1";
  info.accel_pulse_mps = 0.0005;
  info.simulated = true;
  RecordingSink sink(folder_.string());
  ASSERT_TRUE(sink.start(info).ok());
  ASSERT_TRUE(sink.begin_segment({.step = 1}).ok());
  ImuSample sample;
  ASSERT_TRUE(sink.add({&sample, 1}).ok());
  ASSERT_TRUE(sink.end_segment(SegmentKind::still, 1, {}).ok());
  ASSERT_TRUE(sink.sync().ok());
  const std::optional<std::uint32_t> written = sink.written();
  ASSERT_TRUE(written.has_value());
  const auto resumed = [&](const RecordingInfo& with, std::int64_t end_sample, std::uint32_t crc) {
    const std::string copy = path("copy" + std::to_string(++copies_));
    fs::create_directories(copy);
    fs::copy_file(folder_ / partial_recording_name, fs::path(copy) / partial_recording_name);
    const Status status = RecordingSink(copy).resume(with, end_sample, crc);
    return status ? std::string() : status.error().message;
  };
  EXPECT_EQ(resumed(info, 1, *written), "");
  EXPECT_SAYS(resumed(info, 1, *written ^ 1), "is not what this run had recorded by sample 1");
  RecordingInfo real = info, other = info;
  real.simulated = false;
  other.unit_serial = "SN2";
  EXPECT_SAYS(resumed(real, 1, *written), "simulated and real data cannot be one recording");
  EXPECT_SAYS(resumed(other, 1, *written), "another unit");
  EXPECT_SAYS(resumed(info, 2, *written), "does not hold what this run had recorded by sample 2");
}

}  // namespace
}  // namespace turncal
