// `turncal certificate`: what stands on it, and for what there is none.
#include <gtest/gtest.h>

#include <cmath>

#include "orchestrator/report/certificate.h"
#include "tests/orchestrator/results/rig_unit.h"

namespace turncal {
namespace {

class CertificateTest : public RigUnit {
 protected:
  void SetUp() override {
    RigUnit::SetUp();
    write("lab.station",
          "format = 1\nsite.latitude_deg = 29.53\nsite.gravity_mps2 = 9.7914\ntable.driver = mock\nimu.driver = rig\n"
          "laboratory.name = Müller & Söhne <Labor>\nlaboratory.signatory = A. Signer\ncustomer.name = Customer Ltd\n"
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
    file.add_further("record.table_calibration_due", std::string("2027-01-31"));
    return file;
  }
  void keep_run(const ParameterFile& file, const std::string& folder) {
    std::filesystem::create_directories(folder_ / folder);
    keep(file, folder + "/parameters.conf");
  }
  std::vector<std::string> certify(std::vector<std::string> runs, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"certificate"};
    arguments.insert(arguments.end(), runs.begin(), runs.end());
    for (const std::string& word :
         {std::string("--station"), path("lab.station"), std::string("--out"), std::string("c.html")})
      arguments.push_back(word);
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
};

TEST_F(CertificateTest, SaysWhatItHasTo) {
  keep_run(result_file(), "a");
  write("a/verification.conf", "recording_hash = " + std::string(32, '0') +
                                   "\nalign_s = 300\nposition.1.table_deg = 0\nposition.1.mean.heading_deg = 0.00312\n"
                                   "verdict.result = pass\nlimit.heading_deg = 0.012\nlimit.level_deg = 0.012\n");
  const ProgramResult made = run(certify({"a"}));
  ASSERT_EQ(made.code, 0) << made.err;
  const std::string page = file_text(folder_ / "c.html");
  for (const char* words :
       {"Calibration certificate", "Müller &amp; Söhne &lt;Labor&gt;", "Customer Ltd", "SN7", "2027-01-31", "0.0031",
        "ILAC-G8:09/2019", "A. Signer", "counter(pages)", "U (k = 2)", "00000000000000000000000000000000", "hash "})
    EXPECT_NE(page.find(words), std::string::npos) << words;
  EXPECT_EQ(page.find("class=\"mark\""), std::string::npos);
  EXPECT_EQ(run(certify({"a"})).code, 0);  // again, over its own
}

// What the page says of effects follows the diagnosis that was made, or was not.
TEST_F(CertificateTest, SaysWhatIsKnownOfEffects) {
  const auto page_of = [this](const std::string& diagnosis, bool trusted, bool with_effect) {
    ParameterFile file = result_file();
    if (!diagnosis.empty()) file.add_further("verdict.diagnosis", diagnosis);
    if (with_effect) file.effects.push_back({"accel_size_effect", "x_rx", 0.02, 0.001});
    for (auto& [key, value] : file.further)
      if (key == "quality.trusted") value = trusted ? "true" : "false";
    keep_run(file, "a");
    const ProgramResult made = run(certify({"a"}, {"--specimen"}));
    EXPECT_EQ(made.code, 0) << made.err;
    return file_text(folder_ / "c.html");
  };
  const std::string about = "Effects beyond the parameters: ";
  EXPECT_NE(page_of("", true, false).find(about + "not examined.<"), std::string::npos);
  EXPECT_NE(page_of("not_made", false, false).find(about + "not examined, and the standard deviations are not trusted"),
            std::string::npos);
  EXPECT_NE(page_of("clean", true, false).find(about + "none was found.<"), std::string::npos);
  EXPECT_NE(page_of("unexplained", false, false).find(about + "a residual is left that no effect explains."),
            std::string::npos);
  EXPECT_NE(page_of("unexplained", false, true).find(about + "a residual is left"), std::string::npos);
  EXPECT_NE(page_of("extended", true, true).find(about + "those found are in the model.<"), std::string::npos);
  EXPECT_NE(page_of("extended", false, false).find(about + "those found are not in the model, and"), std::string::npos);
  EXPECT_NE(page_of("noise_model", false, false).find(about + "not examined, and"), std::string::npos);
}

// N01 = 0.0071 below 0.0131: the estimate alone leaves room for its guard band, three runs that scatter by 0.006 do not.
TEST_F(CertificateTest, JudgesByTheUncertaintyItPrints) {
  const auto of_run = [this](const std::string& name, double value, const std::string& judgement) {
    ParameterFile file = result_file();
    file.recording_hash = std::string(31, '0') + name;
    file.parameters[0] = value;
    file.add_further("verdict.N01", judgement);
    file.add_further("verdict.A01", std::string("pass, limits none .. 10, guard band 2e-06"));
    keep_run(file, name);
  };
  const std::string limits = "limits -0.0131 .. 0.0131", alone = "pass, " + limits + ", guard band 2e-06";
  of_run("1", -0.0049, alone);
  of_run("2", 0.0011, alone);
  of_run("3", 0.0071, alone);
  ASSERT_EQ(run(certify({"3"})).code, 0);
  std::string page = file_text(folder_ / "c.html");
  EXPECT_NE(page.find("<td>pass</td>"), std::string::npos);
  EXPECT_NE(page.find("pass, " + limits), std::string::npos);
  EXPECT_EQ(page.find("conditional_pass"), std::string::npos);
  ASSERT_EQ(run(certify({"1", "2", "3"})).code, 0);  // U = 2 x 0.006
  page = file_text(folder_ / "c.html");
  EXPECT_NE(page.find("conditional_pass: N01 = 0.0071, " + limits + ", guard band 0.012"), std::string::npos);
  EXPECT_NE(page.find("conditional_pass, " + limits), std::string::npos);
  EXPECT_NE(page.find("pass, limits none .. 10"), std::string::npos);
  EXPECT_EQ(page.find("<td>pass</td>"), std::string::npos);
  // A judgement that was worse already stays.
  of_run("3", 0.0071, "fail, " + limits + ", guard band 2e-06");
  ASSERT_EQ(run(certify({"1", "2", "3"})).code, 0);
  EXPECT_NE(file_text(folder_ / "c.html").find("fail, " + limits), std::string::npos);
  for (const char* wrong : {"perhaps, limits -1 .. 1, guard band 0", "pass, limits -1 1, guard band 0", "pass",
                            "pass, limits -1 .. 1, guard band", "pass, limits x .. 1, guard band 0"}) {
    of_run("3", 0.0071, wrong);
    expect_refused(certify({"3"}), "3/parameters.conf: key 'verdict.N01'");
  }
}

TEST_F(CertificateTest, EachRecordingOnce) {
  ParameterFile file = result_file();
  keep_run(file, "a");
  keep_run(file, "copy");
  expect_refused(certify({"a", "copy"}), "copy/parameters.conf: recording 0000");
  const std::string one(32, '1'), two(32, '2');
  file.recording_hash = one;
  file.add_further("record.recordings", 2.0);
  file.add_further("record.recording.1.hash", one);
  file.add_further("record.recording.2.hash", two);
  keep_run(file, "both");
  ASSERT_EQ(run(certify({"a", "both"})).code, 0);
  EXPECT_NE(file_text(folder_ / "c.html").find(std::string(32, '0') + ", " + one + ", " + two), std::string::npos);
  file = result_file();
  file.recording_hash = two;
  keep_run(file, "second");
  expect_refused(certify({"both", "second"}), "second/parameters.conf: recording 2222");
}

TEST_F(CertificateTest, EachFileApart) {
  keep_run(result_file(), "a");
  expect_refused(certify({"a"}, {"--pdf", "./c.html"}), "--pdf ./c.html: expected another file than --out, c.html");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "c.html"));
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

// The sigma of the file holds what the fit's own covariance does not: the spread over an alias class.
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
    for (auto& [key, value] : file.further)
      if (key == "verdict.result") value = verdict;
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
  ParameterFile file = result_file();
  file.simulated = true;
  keep_run(file, "simulated");
  expect_refused(certify({"simulated"}), "no certificate: its data are simulated", 20);
  ASSERT_EQ(run(certify({"simulated"}, {"--specimen"})).code, 0);
  EXPECT_NE(file_text(folder_ / "c.html").find("SPECIMEN"), std::string::npos);
  std::filesystem::remove(folder_ / "c.html");
  file = result_file();
  for (auto& [key, value] : file.further)
    if (key == "quality.trusted") value = "false";
  keep_run(file, "doubtful");
  expect_refused(certify({"doubtful"}), "no certificate: its sigmas are not trusted", 20);
  file = result_file();
  file.sigma[3].reset();
  keep_run(file, "open");
  expect_refused(certify({"open"}), "it has no standard deviation of A01", 20);
  keep_run(result_file(), "a");
  file = result_file();
  file.unit_serial = "SN8";
  keep_run(file, "other");
  expect_refused(certify({"a", "other"}), "of unit SN8, expected SN7");
  file = result_file();
  file.time_utc = "2025-01-31T12:00:00Z";
  keep_run(file, "older");
  expect_refused(certify({"a", "older"}), "older than the run before it");
  expect_refused(certify({"nothing"}), "nothing");
  write("a/verification.conf", "recording_hash = 1\n");
  expect_refused(certify({"a"}), "is not of the recording");
}

TEST_F(CertificateTest, AsPdf) {
  if (std::system("weasyprint --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no weasyprint";
  keep_run(result_file(), "a");
  const ProgramResult made = run(certify({"a"}, {"--pdf", "c.pdf"}));
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_TRUE(file_text(folder_ / "c.pdf").starts_with("%PDF-"));
  EXPECT_EQ(everything(), (std::set<std::string>{"a", "a/parameters.conf", "c.html", "c.pdf", "lab.station", "rig",
                                                 "rig.rig", "rig.seq", "rig/journal.tcj", "rig/recording.tcr",
                                                 "rig/run.log", "rig/truth.conf"}));
}

}  // namespace
}  // namespace turncal
