// A lot of simulated units through batch and shift report: what the report says against what was laid on.

#include "imu_io/base/clock.h"
#include "orchestrator/line/shift_report.h"
#include "orchestrator/records/results_database.h"
#include "tests/orchestrator/program.h"
#include "turntable_drivers/rig/rig_config.h"

namespace turncal {
namespace {

namespace fs = std::filesystem;

RigConfig lot_of(double faulty) {
  RigConfig config;
  config.lot = {.seed = 3,
                .faulty = faulty,
                .turn_on_gyro_degph = 0.003,
                .turn_on_accel_ug = 20.0,
                .month_gyro_degph = 0.006,
                .month_accel_ug = 60.0};
  return config;
}

RigConfig turned_on(RigConfig config, const std::string& serial, double day) {
  config.start_utc_s += 86400.0 * day;
  return rig_of_lot(config, serial);
}

TEST(RigLot, TheSameSerialIsTheSameUnitAtAnotherTurnOn) {
  const RigConfig a = turned_on(lot_of(0.0), "SN1", 0.0), again = turned_on(lot_of(0.0), "SN1", 0.0);
  const RigConfig later = turned_on(lot_of(0.0), "SN1", 0.1), other = turned_on(lot_of(0.0), "SN2", 0.0);
  EXPECT_EQ(a.truth, again.truth);
  EXPECT_EQ(a.noise_seed, again.noise_seed);
  EXPECT_EQ(a.unit_seed, later.unit_seed);
  EXPECT_NE(a.noise_seed, later.noise_seed);
  EXPECT_NE(*a.truth[0], *later.truth[0]);
  EXPECT_NEAR(*a.truth[0], *later.truth[0], 6.0 * 0.003 * std::sqrt(2.0));
  EXPECT_NE(a.unit_seed, other.unit_seed);
  EXPECT_FALSE(a.truth[6]) << "what does not change follows from the unit's seed";
  const RigConfig plain = rig_of_lot(RigConfig{}, "SN1");
  EXPECT_FALSE(plain.unit_seed || plain.truth[0]) << "without lot.seed nothing changes";
}

// 2000 units: biases step and walk as configured, the share of faulty ones is as asked, and every kind comes.
TEST(RigLot, SpreadsAreAsConfigured) {
  constexpr int units = 2000;
  double turn_on = 0.0, month = 0.0;
  std::map<LotFault, int> faults;
  for (int i = 0; i < units; ++i) {
    const std::string serial = "SN" + std::to_string(i);
    const RigConfig first = turned_on(lot_of(0.0), serial, 10.1), same_day = turned_on(lot_of(0.0), serial, 10.6),
                    later = turned_on(lot_of(0.0), serial, 40.1);
    turn_on += std::pow(*same_day.truth[1] - *first.truth[1], 2) / units;
    month += std::pow(*later.truth[4] - *first.truth[4], 2) / units;
    ++faults[turned_on(lot_of(0.05), serial, 0.0).lot.fault];
  }
  // Differences of two turn-ons: twice the variance; its own scatter over 2000 is 3 %.
  EXPECT_NEAR(std::sqrt(turn_on / 2.0), 0.003, 0.003 * 0.07);
  EXPECT_NEAR(std::sqrt(month), std::sqrt(2.0 * 20.0 * 20.0 + 60.0 * 60.0) * 1e-6, 66e-6 * 0.07);
  const int faulty = units - faults[LotFault::none];
  EXPECT_NEAR(faulty, 100, 5.0 * 9.7) << "binomial, 5 sigma";
  EXPECT_EQ(faults.size(), 6u);
}

class Rehearsal : public Program {};

std::string said_of(const std::string& truth, const std::string& key) {
  const std::size_t at = truth.find(key + " = ");
  return at == std::string::npos ? "" : truth.substr(at + key.size() + 3, truth.find('\n', at) - at - key.size() - 3);
}

// Half of the units faulty, so that few units have many faults. Every unit whose fault shows is stopped, every other passes; what
// was unsettled is done again until it passes; the report's yield is that of the truth.
TEST_F(Rehearsal, TheReportSaysWhatWasLaidOn) {
  const std::string stations = std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/stations/";
  fs::copy_file(stations + "line.station", path("line.station"));
  std::string rig = file_text(stations + "line.rig");
  rig.replace(rig.find("lot.faulty = 0.05"), 17, "lot.faulty = 0.5");
  write("line.rig", rig);
  constexpr int units = 8;
  std::string queue;
  for (int i = 1; i <= units; ++i) queue += "SN" + std::to_string(i) + "\n";
  write("queue", queue);
  const std::vector<std::string> batch = {"batch", "queue", "--dry-run", "--station", "line.station", "--out", "units"};
  ASSERT_EQ(run(batch).code, 20);

  const auto rows = [this](const RecordFilter& filter) {
    const Result<ResultsDatabase> database = ResultsDatabase::open_to_read(path("results.db"));
    return database.ok() ? *database->attempts(filter) : std::vector<AttemptRecord>();
  };
  const std::vector<AttemptRecord> first = rows({});
  ASSERT_EQ(first.size(), std::size_t(units));
  std::set<std::string> kinds;
  std::size_t good = 0;
  std::vector<std::string> again = {"queue", "queue", "--again"};
  for (std::size_t i = 0; i < first.size(); ++i) {
    const AttemptRecord& a = first[i];
    const double since_s = i == 0 ? 900.0 : *parse_utc(a.began_utc) - *parse_utc(first[i - 1].time_utc);
    EXPECT_EQ(since_s, 900.0) << "the clock goes on";
    const std::string truth = file_text(a.folder + "/truth.conf"), fault = said_of(truth, "lot.fault");
    const bool shows = said_of(truth, "lot.fault_shows") == "true";
    EXPECT_EQ(kind_of(a) == AttemptKind::failed, shows)
        << a.unit << " has " << fault << ": " << a.outcome << ": " << a.reason;
    good += !shows;
    if (shows) again.push_back(a.unit);
    if (shows) kinds.insert(fault);
    const std::map<std::string, std::string> named = {
        {"gyro_bias", "N0"}, {"accel_nonlinear", "accel_second_order"}, {"g_sensitive", "gyro_g_sensitivity"}};
    const auto words = named.find(fault);
    if (words == named.end()) continue;
    EXPECT_SAYS(a.reason, words->second) << a.unit << fault;
  }
  EXPECT_GE(kinds.size(), 3u) << "choose another lot.seed";

  ASSERT_EQ(run(again).code, 0);
  (void)run(batch);
  std::size_t still = 0;
  for (const AttemptRecord& a : rows({}))
    if (a.folder.ends_with(".2")) still += said_of(file_text(a.folder + "/truth.conf"), "lot.fault_shows") == "true";
  const ProgramResult shift = ends({"shift", "results.db", "--simulated", "--out", "report"}, 0);
  const std::string csv = file_text(folder_ / "report/shift.csv");
  const auto has = [&csv](const char* quantity, std::size_t value) {
    const std::string line = std::string("yield,all,") + quantity + "," + std::to_string(value) + "\n";
    EXPECT_SAYS(csv, line);
  };
  has("first_pass", good);
  has("first_pass_of", units);
  has("final_pass", units - still);
  has("final_pass_of", units);
  EXPECT_EQ(run({"shift", "results.db", "--simulated", "--out", "report"}).code, 0) << "an earlier report is replaced";
  EXPECT_SAYS(run({"shift", "results.db"}).out, "0 attempts") << "no simulated unit among real ones";
  write("report/shift.csv", "Dear customer,\n");
  expect_refused({"shift", "results.db", "--simulated", "--out", "report"}, "report/shift.csv");
}

// Interrupted and taken up again, the unit is the one that it was, at the time that it was.
TEST_F(Rehearsal, ARunThatGoesOnIsOfTheSameTurnOn) {
  const std::string stations = std::string(TURNCAL_SOURCE_DIR) + "/orchestrator/stations/";
  for (const char* name : {"line.station", "line.rig"}) fs::copy_file(stations + name, path(name));
  const auto of_lot = [this](const std::string& unit, const std::string& out) {
    return quick_run(out, {"--station", "line.station", "--no-diagnosis"}, unit);
  };
  ends(of_lot("SN1", "whole"), 20);  // too short for its limits
  const pid_t pid = start(of_lot("SN2", "cut") + "--pace 60");
  for (int i = 0; i < 400 && !fs::exists(folder_ / "cut/recording.partial.tcr"); ++i) ::usleep(20'000);
  ::usleep(900'000);
  ::kill(pid, SIGTERM);
  ASSERT_EQ(finish(pid).code, 75);
  ends({"resume", "cut"}, 20);
  const std::string truth = file_text(folder_ / "cut/truth.conf");
  fs::remove(path("results.db"));
  ends(of_lot("SN1", "whole.2"), 20);
  ends(of_lot("SN2", "uncut"), 20);
  EXPECT_EQ(file_text(folder_ / "uncut/truth.conf"), truth);
  EXPECT_EQ(file_text(folder_ / "whole.2/truth.conf"), file_text(folder_ / "whole/truth.conf"));
}

}  // namespace
}  // namespace turncal
