#include "calib/evidence/candidate_list.h"

#include <gtest/gtest.h>

namespace turncal {
namespace {

// Scores that see nothing but the columns of `visible_ones`, with these z.
Scores scores_with(const DiagnosisModel& m, const std::vector<std::pair<int, double>>& visible_ones) {
  const auto n = m.columns.size();
  Scores s{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  for (const auto& [k, z] : visible_ones) {
    s.Q(k, k) = 1.0;
    s.s[k] = z;
    s.kept[k] = 0.5;
  }
  return s;
}

int column_of(const DiagnosisModel& m, const std::string& key) {
  for (std::size_t k = 0; k < m.catalogue.size(); ++k)
    if (m.catalogue[k].key() == key) return static_cast<int>(k);
  return -1;
}

CompressedRecording nothing_recorded() {
  CompressedRecording recording;
  recording.info.sample_period_s = 0.005;
  recording.info.latitude_deg = 29.53;
  recording.info.gravity_mps2 = 9.7914;
  recording.info.has_temperature = true;
  return recording;
}

TEST(CandidateList, WhatIsAsGoodIsAnAliasAndARival) {
  const CompressedRecording nothing = nothing_recorded();
  const JoinedRecordings recordings = join_recordings({&nothing});
  const DiagnosisOptions options;
  const DiagnosisModel m(recordings, options);
  const int chosen = column_of(m, "accel_second_order.y"), near = column_of(m, "accel_third_order.y"),
            far = column_of(m, "gyro_g_sensitivity.xx");
  ASSERT_GE(chosen, 0);
  ASSERT_GE(near, 0);
  ASSERT_GE(far, 0);
  const Scores s = scores_with(m, {{chosen, 6.0}, {near, 5.5}, {far, 4.0}});
  SelectionStage stage;
  Diagnosis d;
  name_aliases(m, s, m.catalogue[chosen], 36.0, stage, d);
  EXPECT_EQ(d.aliases["accel_second_order"], std::vector<std::string>{"accel_third_order"});
  ASSERT_EQ(stage.rivals.size(), 1u);
  EXPECT_DOUBLE_EQ(stage.rivals[0].second, 5.5 * 5.5);
  EXPECT_EQ(stage.rival_columns[0].key(), "accel_third_order.y");
}

// An effect chosen by the likelihood may have had a score within the margin of nothing at all.
TEST(CandidateList, WhatCannotBeSeenIsNoRivalOfAWeakScore) {
  const CompressedRecording nothing = nothing_recorded();
  const JoinedRecordings recordings = join_recordings({&nothing});
  const DiagnosisOptions options;
  const DiagnosisModel m(recordings, options);
  const int chosen = column_of(m, "accel_second_order.y");
  SelectionStage stage;
  Diagnosis d;
  name_aliases(m, scores_with(m, {{chosen, 2.5}}), m.catalogue[chosen], 6.25, stage, d);
  EXPECT_TRUE(stage.rivals.empty());
  EXPECT_TRUE(stage.rival_columns.empty());
  EXPECT_TRUE(d.aliases["accel_second_order"].empty());
}

TEST(CandidateList, ListsEachComponentOnceAndNamesWhatIsNotSeen) {
  const CompressedRecording nothing = nothing_recorded();
  const JoinedRecordings recordings = join_recordings({&nothing});
  const DiagnosisOptions options;
  const DiagnosisModel m(recordings, options);
  const int seen = column_of(m, "accel_second_order.y");
  Diagnosis d;
  list_candidates(m, scores_with(m, {{seen, -3.0}}), d);
  ASSERT_EQ(d.groups.size(), 1u);
  EXPECT_EQ(d.groups[0].name, "accel_second_order");
  EXPECT_EQ(d.groups[0].rank, 1);
  EXPECT_DOUBLE_EQ(d.groups[0].chi_square, 9.0);
  EXPECT_EQ(d.undetectable.size(), effect_catalogue().size() - 1);
  int found = 0;
  for (const CandidateScore& c : d.candidates)
    if (c.column.key() == "accel_second_order.y") {
      ++found;
      EXPECT_DOUBLE_EQ(c.z, -3.0);
    }
  EXPECT_EQ(found, 1);
}

}  // namespace
}  // namespace turncal
