#include "calib/evidence/statement.h"

#include <fmt/format.h>

#include <algorithm>

#include "calib/model/effects.h"

namespace turncal {

bool is_below(const Statement& a, const Statement& b) {
  const auto holds = [](const std::string& x, const std::string& y) { return x.empty() || x == y; };
  return a.sensor == b.sensor && holds(a.quantity, b.quantity) && holds(a.driver, b.driver) &&
         holds(a.formula, b.formula) && (a.quantity != b.quantity || a.driver != b.driver || a.formula != b.formula);
}

std::vector<Statement> Statements::said() const {
  std::vector<Statement> said;
  for (const Statement& a : nodes) {
    if (a.probability < said_from) continue;
    const bool deepest =
        std::ranges::none_of(nodes, [&](const Statement& b) { return b.probability >= said_from && is_below(a, b); });
    if (deepest) said.push_back(a);
  }
  return said;
}

std::string words_of_probability(double p) {
  return p > 0.995 ? "more than 0.99" : p < 0.005 ? "less than 0.01" : fmt::format("{:.2f}", p);
}

namespace {

std::string sentence(const Statement& s) {
  if (s.sensor == to_string(Sensor::earth_rate))
    return "the Earth's rate is not as modelled (" + words_of_probability(s.probability) + ")";
  const bool of_all = s.sensor == "gyro" || s.sensor == "accelerometer";  // a whole triad
  const std::string sensor = of_all ? "the " + s.sensor + " triad" : s.sensor;
  const std::string of = s.quantity.empty() ? sensor : "the " + s.quantity + " of " + sensor;
  static const std::vector<std::pair<std::string, std::string>> drivers = {
      {"time", "changes with time"},
      {"temperature", "depends on the temperature"},
      {"turns", "changes after a turn"},
      {"angle", "depends on an angle of the table"},
      {"force", "depends on the specific force"},
      {"rate", "depends on the rate of rotation"},
      {"field", "depends on the direction of north or up"}};
  const auto found = std::ranges::find_if(drivers, [&](const auto& d) { return d.first == s.driver; });
  return fmt::format("{} {} ({})", of, found == drivers.end() ? "is not as modelled" : found->second,
                     words_of_probability(s.probability));
}

}  // namespace

std::string words_of(const Statements& statements) {
  std::string words, before;
  for (const Statement& s : statements.said()) {
    const std::string branch = fmt::format("{}, {}, {}", s.sensor, s.quantity, s.driver);
    if (branch == before) continue;  // further formulas of the same branch follow it
    before = branch;
    words += (words.empty() ? "" : "; ") + sentence(s);
    std::string formulas;
    for (const Statement& f : statements.nodes)
      if (!f.formula.empty() && f.sensor == s.sensor && (s.quantity.empty() || f.quantity == s.quantity) &&
          (s.driver.empty() || f.driver == s.driver)) {
        const bool sure = f.probability >= said_from, first = formulas.empty();
        formulas += fmt::format("{}{} ({})", first ? (sure ? ", by " : ", perhaps by ") : (sure ? " and " : " or "),
                                f.formula, words_of_probability(f.probability));
      }
    words += formulas;
  }
  return words;
}

std::string reason_of(const Statements& s) {
  const std::string probability = words_of_probability(s.anything), words = words_of(s);
  if (s.anything < said_from)
    return fmt::format("the probability that something is missing is {}, and a claim needs {}", probability, said_from);
  return "something is missing with a probability of " + probability + (words.empty() ? "" : ": " + words);
}

}  // namespace turncal
