// Nelson's eight tests: on series made for each, and how often each sounds when nothing is wrong.
#include "orchestrator/line/parameter_history.h"

#include "tests/test.h"

namespace turncal {
namespace {

std::vector<std::size_t> rules_at(const std::vector<double>& z, std::size_t point) {
  std::vector<std::size_t> rules;
  for (const RunSignal& signal : run_signals(z))
    if (signal.point == point) rules.push_back(signal.rule);
  return rules;
}
using Rules = std::vector<std::size_t>;

// Each series gives its signal at the last point, and one step less of it gives none.
TEST(RunRules, EachOnASeriesMadeForIt) {
  EXPECT_EQ(rules_at({0.1, -0.2, 3.1}, 2), Rules{1});
  EXPECT_EQ(rules_at({0.1, -0.2, -3.1}, 2), Rules{1});
  EXPECT_EQ(rules_at({0.1, -0.2, 2.9}, 2), Rules{});

  const std::vector<double> nine = {-0.5, 0.3, 1.2, 0.2, 0.5, 1.4, 0.1, 0.3, 0.2, 0.6};
  EXPECT_EQ(rules_at(nine, 9), Rules{2});
  EXPECT_EQ(rules_at({nine.begin(), nine.end() - 1}, 8), Rules{});

  EXPECT_EQ(rules_at({0.9, -1.5, -0.8, -0.1, 0.2, 0.9, 1.3}, 6), Rules{3});
  EXPECT_EQ(rules_at({-0.9, 1.5, 0.8, 0.1, -0.2, -0.9, -1.3}, 6), Rules{3});
  EXPECT_EQ(rules_at({0.9, -1.5, -0.8, -0.1, 0.2, 0.9}, 5), Rules{}) << "five rising";
  EXPECT_EQ(rules_at({0.9, -1.5, -0.8, -0.8, 0.2, 0.9, 1.3}, 6), Rules{}) << "two alike do not rise";

  std::vector<double> turns;
  for (int i = 0; i < 14; ++i) turns.push_back(i % 2 == 0 ? 1.2 + 0.01 * i : -0.4 - 0.01 * i);
  EXPECT_EQ(rules_at(turns, 13), Rules{4});
  EXPECT_EQ(rules_at({turns.begin(), turns.end() - 1}, 12), Rules{});

  EXPECT_EQ(rules_at({0.1, 2.1, -0.3, 2.2}, 3), Rules{5});
  EXPECT_EQ(rules_at({0.1, 2.1, -0.3, -2.2}, 3), Rules{}) << "one on each side";
  EXPECT_EQ(rules_at({2.1, 0.1, -0.3, 2.2}, 3), Rules{}) << "two of four";

  EXPECT_EQ(rules_at({-0.2, 1.1, 1.4, -0.3, 1.2, 1.3}, 5), Rules{6});
  EXPECT_EQ(rules_at({-0.2, 1.1, 1.4, -0.3, 0.9, 1.3}, 5), Rules{});
  EXPECT_EQ(rules_at({-0.2, 1.1, 1.4, -0.3, -1.2, 1.3}, 5), Rules{});

  std::vector<double> narrow = {1.5};
  for (int i = 0; i < 15; ++i) narrow.push_back(0.1 * ((i * 7) % 5) - 0.25 + (i % 3 == 0 ? 0.3 : 0.0));
  EXPECT_EQ(rules_at(narrow, 15), Rules{7});
  narrow[8] = -1.1;
  EXPECT_EQ(rules_at(narrow, 15), Rules{});

  EXPECT_EQ(rules_at({0.0, 1.2, 1.3, -1.1, 1.5, -1.4, -1.2, 1.6, -1.3}, 8), Rules{8});
  EXPECT_EQ(rules_at({0.0, 1.2, 1.3, -1.1, 0.5, -1.4, -1.2, 1.6, -1.3}, 8), Rules{});
}

// Four million points of a series in control: each rule sounds as often as its table says, within 5 standard errors. Signals that
// overlap are not independent: the error is that of as few as one in `stretch` of them.
TEST(RunRules, FalseAlarmsAreAsOftenAsStated) {
  constexpr std::size_t points = 4'000'000;
  std::mt19937_64 random(1984);
  std::normal_distribution<double> normal;
  std::vector<double> z(points);
  for (double& value : z) value = normal(random);
  std::array<double, 8> count{};
  std::vector<char> any(points);
  for (const RunSignal& signal : run_signals(z)) {
    ++count[signal.rule - 1];
    any[signal.point] = 1;
  }
  for (std::size_t i = 0; i < run_rules.size(); ++i) {
    const RunRule& rule = run_rules[i];
    const double expected = rule.false_alarm * points;
    const double error = std::sqrt(expected * double(rule.stretch));
    EXPECT_NEAR(count[i], expected, 5.0 * error + 0.005 * expected) << "rule " << i + 1;  // stated to three digits
  }
  const auto all = double(std::ranges::count(any, 1)) / points;
  EXPECT_NEAR(all, 0.0256, 0.0005) << "of any rule, as docs/fleet.md says";
}

// The intervals of Cpk and Ppk hold the true index in 95 % of the samples, or near it: Bissell's is an approximation.
TEST(Capability, IntervalsHoldTheTrueIndex) {
  constexpr int samples = 4000;
  constexpr std::size_t units = 40;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0.5, 1.0);
  const Limit limit{-4.0, 4.0};  // true index (4 - 0.5) / 3
  int held_cpk = 0, held_ppk = 0;
  for (int i = 0; i < samples; ++i) {
    std::vector<double> values(units);
    for (double& value : values) value = normal(random);
    const ControlChart chart = control_chart(values, limit);
    const auto holds = [](const Capability& c) { return c.low <= 3.5 / 3.0 && 3.5 / 3.0 <= c.high; };
    held_cpk += holds(*chart.cpk);
    held_ppk += holds(*chart.ppk);
  }
  EXPECT_NEAR(held_cpk / double{samples}, 0.95, 0.02);
  EXPECT_NEAR(held_ppk / double{samples}, 0.95, 0.02);
}

TEST(Capability, OfAllIsSmallerThanShortTermWhenTheLineDrifts) {
  std::mt19937_64 random(6);
  std::normal_distribution<double> normal;
  std::vector<double> values;
  for (int i = 0; i < 100; ++i) values.push_back(normal(random) + 0.05 * i);
  const ControlChart chart = control_chart(values, {-10.0, 15.0});
  EXPECT_GT(chart.cpk->value, 1.4 * chart.ppk->value);
}

}  // namespace
}  // namespace turncal
