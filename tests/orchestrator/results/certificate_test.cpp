// `turncal certificate`: what stands on it, and for what there is none.

#include "orchestrator/report/certificate.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class CertificateTest : public RigUnit {
 protected:
  void SetUp() override {
    RigUnit::SetUp();
    write(
        "lab.station",
        station_head +
            "laboratory.name = Müller & Söhne <Labor>\nlaboratory.signatory = A. Signer\ncustomer.name = Customer Ltd\n"
            "laboratory.address = Weg 1\ncustomer.address = Way 2\n"
            "site.gravity_uncertainty_mps2 = 0.0001\nsite.latitude_uncertainty_deg = 0.001\n");
    record("rig", without_noise, "step 1\n  initial H 0 P 0 R 0\n  align 200\n  dwell 200\n");
  }
  // A result as a run leaves it, of a real unit.
  ParameterFile result_file() {
    ParameterFile file = truth_of("rig");
    file.simulated = false;
    for (std::size_t k = 0; k < parameter_keys.size(); ++k)
      if (parameter_is_free[k]) file.sigma[k] = 1e-6;
    file.add_further("quality.trusted", std::string("true"));
    file.add_further("verdict.result", std::string("pass"));
    file.add_further("verdict.rule", std::string("ILAC-G8:09/2019 4.2.3"));
    file.add_further("record.began_utc", std::string("2026-01-31T10:00:00Z"));
    file.add_further("record.table_id", std::string("TT-1"));
    file.add_further("record.table_calibration_due", std::string("2027-01-31"));
    return file;
  }
  static void set(ParameterFile& file, const std::string& wanted, const std::string& to) {
    for (auto& [key, value] : file.further)
      if (key == wanted) value = to;
  }
  // Of that result, as `turncal verify` would have made it.
  static VerificationReport verification_of(const ParameterFile& file) {
    VerificationReport report;
    report.info.unit_serial = file.unit_serial;
    report.info.latitude_deg = file.latitude_deg;
    report.info.gravity_mps2 = file.gravity_mps2;
    report.recording_hash = file.recording_hash;
    report.parameters = "parameters.conf";
    report.calibration_hash = *calibration_hash(file);
    report.align_s = 300.0;
    NorthPosition position;
    position.readings.resize(2);
    position.mean_deg = {0.00312, 0.0, 0.0};
    report.found.positions = {position, position};
    report.felt = {file.latitude_deg * rad_per_deg, 1e-4, file.gravity_mps2};
    report.heading_limit_deg = report.level_limit_deg = 0.012;
    report.heading = report.level = report.latitude = report.gravity = report.verdict = UnitVerdict::pass;
    return report;
  }
  void keep_verification(const VerificationReport& report, const std::string& folder) {
    write(folder + "/verification.conf", format_verification(report));
  }
  void keep_run(const ParameterFile& file, const std::string& folder) {
    std::filesystem::create_directories(folder_ / folder);
    keep(file, folder + "/parameters.conf");
  }
  static Arguments certify(const Arguments& runs, const Arguments& more = {}) {
    return "certificate" + runs + "--station lab.station --out c.html" + more;
  }
};

TEST_F(CertificateTest, SaysWhatItHasTo) {
  keep_run(result_file(), "a");
  keep_verification(verification_of(result_file()), "a");
  ends(certify({"a"}), 0);
  const std::string page = file_text(folder_ / "c.html");
  for (const char* words : {"Calibration certificate", "Müller &amp; Söhne &lt;Labor&gt;", "Customer Ltd", "SN7",
                            "2027-01-31", "0.0031", "2026-01-31T10:00:00Z", "ILAC-G8:09/2019", "A. Signer",
                            "counter(pages)", "U (k = 2)", "00000000000000000000000000000000", "hash "})
    EXPECT_SAYS(page, words);
  EXPECT_SAYS_NOT(page, "class=\"mark\"");
  EXPECT_EQ(run(certify({"a"})).code, 0);  // again, over its own
}

// N01 = 0.0071 below 0.0131: the estimate alone leaves room for its guard band, three runs that scatter by 0.006 do not.
TEST_F(CertificateTest, JudgesByTheUncertaintyItPrints) {
  const auto of_run = [this](const std::string& name, double value, const std::string& judgement) {
    ParameterFile file = result_file();
    file.recording_hash = std::string(31, '0') + name;
    file.parameters[0] = value;
    file.add_further("verdict.N01", judgement);
    file.add_further("verdict.A01", std::string("pass, limits none .. 10, guard band 2e-06"));
    file.add_further("verdict.sigma.A01", std::string("pass, limits none .. 0.5, guard band 0"));
    file.add_further("verdict.residual", std::string("pass, limits none .. 1.3, guard band 0"));
    keep_run(file, name);
  };
  const std::string limits = "limits -0.0131 .. 0.0131", alone = "pass, " + limits + ", guard band 2e-06";
  of_run("1", -0.0049, alone);
  of_run("2", 0.0011, alone);
  of_run("3", 0.0071, alone);
  ASSERT_EQ(run(certify({"3"})).code, 0);
  std::string page = file_text(folder_ / "c.html");
  EXPECT_SAYS(page, "<td>pass</td>");
  EXPECT_SAYS(page, "pass, " + limits);
  EXPECT_SAYS_NOT(page, "conditional pass");
  EXPECT_SAYS(page, "pass, at most 10; sigma: pass, at most 0.5");
  EXPECT_SAYS(page, "at most 1.3: pass");
  ASSERT_EQ(run(certify({"1", "2", "3"})).code, 0);  // U = 2 x 0.006
  page = file_text(folder_ / "c.html");
  EXPECT_SAYS(page, "conditional pass: gyro x bias (N01) 0.007 deg/h, " + limits + ", guard band 0.012");
  EXPECT_SAYS(page, "conditional pass, " + limits);
  EXPECT_SAYS(page, "pass, at most 10");
  EXPECT_SAYS_NOT(page, "<td>pass</td>");
  // A judgement that was worse already stays.
  of_run("3", 0.0071, "fail, " + limits + ", guard band 2e-06");
  ASSERT_EQ(run(certify({"1", "2", "3"})).code, 0);
  EXPECT_SAYS(file_text(folder_ / "c.html"), "fail, " + limits);
  for (const char* wrong : {"perhaps, limits -1 .. 1, guard band 0", "pass, limits -1 1, guard band 0", "pass",
                            "pass, limits -1 .. 1, guard band", "pass, limits x .. 1, guard band 0"}) {
    of_run("3", 0.0071, wrong);
    expect_refused(certify({"3"}), "3/parameters.conf: key 'verdict.N01'");
  }
}

TEST_F(CertificateTest, BudgetByHand) {
  Parties parties;
  parties.gravity_uncertainty_mps2 = 1e-4;
  parties.latitude_uncertainty_deg = 0.001;
  ParameterFile first = result_file(), second = result_file();
  first.parameters[15] = 1.0;
  second.parameters[15] = 1.00002;
  const UncertaintyBudget of_scale = budget_of({first, second}, 15, parties);
  EXPECT_NEAR(of_scale.gravity, 1.00002 * 1e-4 / 9.7914, 1e-12);
  EXPECT_NEAR(*of_scale.repeatability, 0.00002 / std::sqrt(2.0), 1e-12);
  EXPECT_EQ(of_scale.latitude, 0.0);
  EXPECT_NEAR(of_scale.expanded(), 2.0 * std::sqrt(1e-12 + 1.02133e-5 * 1.02133e-5 + 2e-10), 1e-9);
  const UncertaintyBudget of_bias = budget_of({first}, 0, parties);
  EXPECT_NEAR(of_bias.latitude, 15.041 * 0.001 / 57.29578, 1e-7);  // deg/h
  EXPECT_EQ(of_bias.gravity, 0.0);
  EXPECT_FALSE(of_bias.repeatability);
}

// The sigma of the file holds what the fit's own covariance does not: the spread over confounded effects.
TEST_F(CertificateTest, TheAliasClassHasItsNumber) {
  ParameterFile file = result_file();
  file.sigma[3] = 5e-6;
  file.add_further("verdict.diagnosis", std::string("clean"));
  file.add_further("quality.alias.A01", std::string("4e-06"));
  const UncertaintyBudget budget = budget_of({file}, 3, {});
  EXPECT_NEAR(budget.estimate, 3e-6, 1e-15);
  ASSERT_TRUE(budget.alias);
  EXPECT_NEAR(*budget.alias, 4e-6, 1e-15);
  EXPECT_NEAR(budget.expanded(), 10e-6, 1e-15);
  EXPECT_EQ(*budget_of({file}, 4, {}).alias, 0.0);
  EXPECT_FALSE(budget_of({result_file()}, 3, {}).alias);
}

TEST_F(CertificateTest, AUnitThatDoesNotConformIsSaidToBeSuchAtTheTop) {
  for (const auto& [verdict, words] :
       {std::pair{"fail", "NOT CONFORMING: the unit does not keep its limits"},
        std::pair{"conditional_fail", "NOT CONFORMING: outside the limits by less than the uncertainty"},
        std::pair{"hold", "NO STATEMENT OF CONFORMITY"}, std::pair{"pass", ""}, std::pair{"conditional_pass", ""}}) {
    ParameterFile file = result_file();
    set(file, "verdict.result", verdict);
    keep_run(file, "a");
    ASSERT_EQ(run(certify({"a"})).code, 0);
    const std::string page = file_text(folder_ / "c.html");
    const std::size_t at = page.find("class=\"not\"");
    EXPECT_EQ(at == std::string::npos, *words == '\0') << verdict;
    if (*words != '\0') {
      EXPECT_EQ(page.find(words), at + std::string("class=\"not\">").size()) << verdict;
      EXPECT_LT(at, page.find("Laboratory"));
    }
  }
}

TEST_F(CertificateTest, NoneForWhatIsNoResult) {
  keep_run(result_file(), "a");
  struct Row {
    std::function<void(ParameterFile&)> change;
    Arguments beside;
    const char* says;
    int code = 1;
  };
  for (const auto& [change, beside, says, code] :
       {Row{[](ParameterFile& f) { f.simulated = true; }, {}, "no certificate: its data are simulated", 20},
        Row{[](ParameterFile& f) { set(f, "quality.trusted", "false"); }, {}, "its sigmas are not trusted", 20},
        Row{[](ParameterFile& f) { f.sigma[3].reset(); }, {}, "it has no standard deviation of A01", 20},
        Row{[](ParameterFile& f) { f.unit_serial = "SN8"; }, {"a"}, "of unit SN8, expected SN7"},
        Row{[](ParameterFile& f) { f.time_utc = "2025-01-31T12:00:00Z"; }, {"a"}, "older than the run before it"}}) {
    ParameterFile file = result_file();
    change(file);
    keep_run(file, "b");
    expect_refused(certify(beside + Arguments{"b"}), says, code);
  }
}

// An extended model has more to certify than 24 numbers.
TEST_F(CertificateTest, EachEffectWithItsUncertainty) {
  ParameterFile file = result_file();
  file.add_further("verdict.diagnosis", std::string("extended"));
  file.effects = {
      {"accel_delay", "tau", 0.1197, 0.0029}, {"gyro_warm_up", "x", 0.5, 0.1}, {"gyro_warm_up", "tau_s", 240.0, {}}};
  keep_run(file, "a");
  ASSERT_EQ(run(certify({"a"})).code, 0);
  std::string page = file_text(folder_ / "c.html");
  for (const char* words :
       {"accel_delay.tau", "<td>ms</td>", "0.1197", "0.0058", "gyro_warm_up.tau_s", "<td>s</td>", "given",
        "effects beyond the parameters: those found are in the model: accel_delay, gyro_warm_up."})
    EXPECT_SAYS(page, words);
  ParameterFile later = file;
  later.recording_hash = std::string(32, '1');
  later.effects[0].value = 0.1297;
  const UncertaintyBudget budget = budget_of({file, later}, later.effects[0]);
  EXPECT_NEAR(*budget.repeatability, 0.01 / std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(budget.expanded(), 2.0 * std::hypot(0.0029, 0.01 / std::sqrt(2.0)), 1e-12);
  EXPECT_FALSE(budget_of({file, later}, later.effects[2]).repeatability);
}

// What stands beside the result has to be of it, whole, and what its verdict was made of.
TEST_F(CertificateTest, TheVerificationOfThisResult) {
  ParameterFile file = result_file();
  VerificationReport report = verification_of(file);
  file.add_further("verdict.verification", "pass: " + verification_words(report));
  keep_run(file, "a");
  EXPECT_EQ(*calibration_hash(file), report.calibration_hash);  // the verdict is not in it
  keep_verification(report, "a");
  ASSERT_EQ(run(certify({"a"})).code, 0);
  std::filesystem::remove(folder_ / "c.html");
  EXPECT_EQ(format_verification(*read_verification(path("a/verification.conf"))), format_verification(report));
  const std::string whole = format_verification(report);
  const auto refused = [&](std::string text, const char* words) {
    write("a/verification.conf", text);
    expect_refused(certify({"a"}), words);
  };
  std::string edited = whole;
  edited.replace(edited.find("verdict.result = pass"), 21, "verdict.result = hold");
  refused(edited, "a/verification.conf: wrong checksum");
  refused(whole.substr(0, whole.find("checksum")), "a/verification.conf: no checksum");
  const auto changed = [&](const std::string& line, const std::string& by) {
    std::string text = whole.substr(0, whole.find("checksum"));
    const std::size_t at = text.find(line);
    return with_checksum(text.replace(at, text.find('\n', at) + 1 - at, by));
  };
  refused(changed("position.1.mean.heading_deg", "position.1.mean.heading_deg = x\n"), "expected a number");
  refused(changed("position.1.mean.heading_deg", "position.1.mean.heading_deg = 1e999\n"), "expected a number");
  refused(changed("position.1.mean.heading_deg", "position.1.mean.heading_deg =\n"), "expected a number");
  refused(changed("position.1.mean.heading_deg", ""), "position.1.mean.heading_deg");
  refused(changed("verdict.result", "verdict.result = great\n"), "expected a verdict");
  refused(changed("format", "format = 2\n"), "'format' = '2'");
  refused(changed("recording_hash", ""), "recording_hash");
  refused(changed("position.2.table_deg", ""), "position.2.");
  const auto refused_report = [&](auto change, const char* words) {
    VerificationReport other = report;
    change(other);
    refused(format_verification(other), words);
  };
  refused_report([](VerificationReport& r) { r.info.unit_serial = "ZZ"; }, "unit 'ZZ': expected '");
  refused_report([](VerificationReport& r) { r.recording_hash = "1"; }, "recording '1': expected '");
  refused_report([](VerificationReport& r) { r.calibration_hash = "1"; }, "calibration '1': expected '");
  refused_report([](VerificationReport& r) { r.heading_limit_deg = 1.0; }, "result '");
  refused_report([](VerificationReport& r) { r.verdict = UnitVerdict::hold; }, "result '");
  std::filesystem::remove(folder_ / "a/verification.conf");
  expect_refused(certify({"a"}), "a/verification.conf: missing: the verdict of parameters.conf quotes");
}

TEST_F(CertificateTest, NoneWithoutWhatHasToStandOnIt) {
  keep_run(result_file(), "a");
  const std::string station = file_text(folder_ / "lab.station");
  write("lab.station", station_head);
  expect_refused(certify({"a"}),
                 "lab.station: no certificate without laboratory.name, laboratory.address, laboratory.signatory, "
                 "customer.name, customer.address (--specimen");
  EXPECT_EQ(run(certify({"a"}, {"--specimen"})).code, 0);
  std::filesystem::remove(folder_ / "c.html");
  write("lab.station", station);
  ParameterFile file = result_file();
  std::erase_if(file.further, [](const auto& entry) { return entry.first.starts_with("record."); });
  keep_run(file, "a");
  expect_refused(certify({"a"}), "no certificate without table.id (when it was measured), table.calibration_due");
  write("lab.station", station + "customer.order = \xe9\n");
  expect_refused(certify({"a"}), "expected printable text in UTF-8");
}

TEST_F(CertificateTest, AsPdf) {
  if (std::system("weasyprint --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no weasyprint";
  keep_run(result_file(), "a");
  const ProgramResult made = ends(certify({"a"}, {"--pdf", "c.pdf"}), 0);
  EXPECT_TRUE(file_text(folder_ / "c.pdf").starts_with("%PDF-"));
  EXPECT_SAYS_NOT(made.out, "font");
  EXPECT_EQ(everything(), (std::set<std::string>{"a", "a/parameters.conf", "c.html", "c.pdf", "lab.station", "rig",
                                                 "rig.rig", "rig.seq", "rig/journal.tcj", "rig/recording.tcr",
                                                 "rig/run.log", "rig/truth.conf"}));
  // A character of the private use area, which no font has.
  write("lab.station", file_text(folder_ / "lab.station") + "customer.order = \xf4\x8f\xbf\xbd\n");
  const ProgramResult blank = ends(certify({"a"}, {"--pdf", "c.pdf"}), 0);
  EXPECT_SAYS(blank.out, "no installed font has \xf4\x8f\xbf\xbd (U+10FFFD)");
}

}  // namespace
}  // namespace turncal
