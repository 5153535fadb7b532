// `turncal certificate`: what stands on it, and for what there is none.
#include <gtest/gtest.h>

#include <cmath>

#include "orchestrator/report/certificate.h"
#include "tests/orchestrator/rig_unit.h"

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
