// The journal on disk: what is written is read back; damage is told from a torn end; nothing is read that was not written.
#include "orchestrator/records/journal.h"

#include "tests/orchestrator/program.h"

namespace turncal {
namespace {

class Journal : public testing::Test {
 protected:
  std::string path() const { return folder_ / "journal.tcj"; }
  void write_some() const {
    Result<JournalFile> journal =
        good(JournalFile::create(path(), {{"unit", "SN 7"}, {"station", " 100% # \n odd "}, {"rig", ""}}));
    ASSERT_TRUE(journal->command({0.5, {}}).ok());
    ASSERT_TRUE(journal->command({1.25, Move{Axis::pitch, 90.0, 10.0, 20.0}}).ok());
    ASSERT_TRUE(journal->dwell(one_).ok());
    ASSERT_TRUE(journal->command({3.0, Move{Axis::roll, -720.125, 0.1, 1e-3}}).ok());
    ASSERT_TRUE(journal->append(JournalType::resume, {{"what", "x"}}).ok());
    ASSERT_TRUE(journal->command({4.0, Move{Axis::heading, 1.0, 2.0, 3.0}}).ok());
    ASSERT_TRUE(journal->dwell(two_).ok());
    journal->note_clocks({UnitClock{-12.34, 0.05}});
    ASSERT_TRUE(journal->seal(1767225600.25, {"00ff"}).ok());
  }
  const CompletedDwell one_{.item = 0,
                            .units = {{.next_sample = 1000, .first_counter = -5, .last_counter = 994}},
                            .time_s = 2.0,
                            .utc_s = 7.0};
  const CompletedDwell two_{.item = 3,
                            .units = {{.next_sample = 1'000'000'000'000,
                                       .first_counter = -5,
                                       .last_counter = 999'999'999'994,
                                       .lost_samples = 3,
                                       .duplicate_samples = 4}},
                            .repeated_dwells = 2,
                            .time_s = 0.1 + 0.2,
                            .utc_s = 1e9 / 3};
  const TemporaryFolder folder_;
};

TEST_F(Journal, IsReadBackAsWritten) {
  write_some();
  const Result<JournalContents> contents = good(read_journal(path()));
  EXPECT_EQ(contents->begin_value("unit"), "SN 7");
  EXPECT_EQ(contents->hashes, std::vector<std::string>{"00ff"});
  ASSERT_EQ(contents->clocks.size(), 1u);
  EXPECT_EQ(contents->clocks[0], (UnitClock{-12.34, 0.05}));
  EXPECT_EQ(contents->begin_value("station"), " 100% # \n odd ");
  EXPECT_EQ(contents->begin_value("rig"), "");
  ASSERT_TRUE(contents->last_dwell);
  EXPECT_EQ(*contents->last_dwell, two_);
  EXPECT_EQ(*contents->seal_utc_s, 1767225600.25);
  EXPECT_EQ(contents->sessions, 2);
  EXPECT_TRUE(contents->verdicts.empty());
  // The move after the first dwell was taken back by the resume.
  ASSERT_EQ(contents->commands.size(), 3u);
  EXPECT_FALSE(contents->commands[0].move);
  EXPECT_EQ(contents->commands[1].move->target_deg, 90.0);
  EXPECT_EQ(contents->commands[2].move->axis, Axis::heading);
  const Result<std::string> text = good(journal_as_text(path()));
  EXPECT_EQ(std::count(text->begin(), text->end(), '\n'), 9);
}

// Whoever takes the run up again without reaching the table does not take the warning back. A pause is what nothing else has stopped.
TEST_F(Journal, TheTableIsUnknownUntilAStopIsVerified) {
  write_some();
  using enum RunState;
  using enum RunEvent;
  for (const auto& [from, event, to, unknown, pause] : {std::tuple(idle, start, connecting, false, false),
                                                        {dwelling, pause_wanted, dwelling, true, true},
                                                        {dwelling, end_wanted, stopping, true, false},
                                                        {stopping, deadline, failed, true, false},
                                                        {connecting, connect_failed, failed, true, false},
                                                        {selecting, pause_wanted, stopping, true, true},
                                                        {stopping, stopped_verified, interrupted, false, true}}) {
    EXPECT_TRUE(good(JournalFile::reopen(path()))->transition({{}, from, event, to, RunAction::none, false, ""}));
    const Result<JournalContents> contents = good(read_journal(path()));
    EXPECT_EQ(contents->table_warning().empty(), !unknown) << to_string(event);
    EXPECT_EQ(contents->pause_asked, pause) << to_string(event);
  }
}

TEST_F(Journal, CutAnywhereItIsAPrefixOrNothing) {
  write_some();
  const std::string whole = file_text(path());
  std::size_t readable = 0;
  for (std::size_t length = 0; length < whole.size(); ++length) {
    std::ofstream(path(), std::ios::binary | std::ios::trunc) << whole.substr(0, length);
    const Result<JournalContents> contents = read_journal(path());
    if (!contents) {
      ASSERT_EQ(readable, 0u) << "not readable at " << length;
      continue;
    }
    ++readable;
    ASSERT_FALSE(contents->last_dwell && !(*contents->last_dwell == one_) && !(*contents->last_dwell == two_))
        << length;
    ASSERT_EQ(contents->begin_value("unit"), "SN 7");
    // It can be gone on with, and what is appended follows what was whole.
    if (length % 7 != 0) continue;
    Result<JournalFile> journal = good(JournalFile::reopen(path()));
    ASSERT_TRUE(journal->seal(5.0, {}).ok());
    const Result<JournalContents> more = good(read_journal(path()));
    ASSERT_EQ(*more->seal_utc_s, 5.0);
  }
  EXPECT_GT(readable, whole.size() / 2);
}

TEST_F(Journal, AFlippedBitIsNeverReadAsSomethingElse) {
  write_some();
  const std::string whole = file_text(path());
  const std::string text = *journal_as_text(path());
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string bad = whole;
    bad[i] = char(bad[i] ^ (1 << (i % 8)));
    std::ofstream(path(), std::ios::binary | std::ios::trunc) << bad;
    const Result<JournalContents> contents = read_journal(path());
    if (!contents) continue;  // damage in the middle
    // Only the last record may go unnoticed, as torn.
    ASSERT_FALSE(contents->seal_utc_s) << "byte " << i;
    ASSERT_EQ(*contents->last_dwell, two_) << "byte " << i;
  }
}

}  // namespace
}  // namespace turncal
