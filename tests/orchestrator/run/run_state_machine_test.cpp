// The transition table is complete, unambiguous and the one that docs/architecture.md draws.
#include "orchestrator/run/run_state_machine.h"

#include "tests/test.h"

namespace turncal {
namespace {

template <class Enum>
std::vector<Enum> all_of() {
  std::vector<Enum> all;
  for (std::size_t i = 0; i < enum_words<Enum>.size(); ++i) all.push_back(static_cast<Enum>(i));
  return all;
}
const std::vector<RunState> all_states = all_of<RunState>();
const std::vector<RunEvent> all_events = all_of<RunEvent>();
std::vector<GuardSet> all_guards() {
  std::vector<GuardSet> all;
  for (const RunGuard cause : {RunGuard::by_error, RunGuard::by_operator, RunGuard::by_interruption})
    for (int bits = 0; bits < 4; ++bits) all.push_back(guards_of((bits & 2) != 0, (bits & 1) != 0, cause));
  return all;
}
const GuardSet usual_guards = guards_of(false, true, RunGuard::by_error);

int taken_rows(RunState state, RunEvent event, GuardSet guards) {
  int count = 0;
  for (const TransitionRow& row : transition_table)
    if (row.from.contains(state) && row.events.contains(event) && guards.contains(row.guard)) ++count;
  return count;
}
bool listed_ignored(RunState state, RunEvent event) {
  for (const IgnoredRow& row : ignored_events)
    if (row.in.contains(state) && row.events.contains(event)) return true;
  return false;
}

TEST(RunStateMachine, NamesAreCompleteAndDistinct) {
  const auto distinct = [](const auto& all) {
    std::set<std::string_view> names;
    for (const auto one : all) names.insert(to_string(one));
    return names.size();
  };
  EXPECT_EQ(distinct(all_states), std::size_t(RunState::interrupted) + 1);
  EXPECT_EQ(distinct(all_events), std::size_t(RunEvent::end_wanted) + 1);
  EXPECT_EQ(distinct(all_of<RunAction>()), std::size_t(RunAction::announce) + 1);
}

// For every pair and every combination of guards: exactly one row, or explicitly ignored, or unexpected; never two.
TEST(RunStateMachine, EveryPairHasExactlyOneOutcome) {
  for (RunState state : all_states) {
    for (RunEvent event : all_events) {
      for (const GuardSet guards : all_guards()) {
        const std::string where = std::string(to_string(state)) + " + " + std::string(to_string(event));
        const int rows = taken_rows(state, event, guards);
        const bool ignored = listed_ignored(state, event);
        EXPECT_LE(rows + (ignored ? 1 : 0), 1) << where;
        const Transition transition = next(state, event, guards);
        if (is_final(state)) {
          EXPECT_EQ(transition.to, state) << where;
        }
        if (rows == 1) {
          EXPECT_EQ(transition.outcome, Transition::Outcome::taken) << where;
        } else if (ignored) {
          EXPECT_EQ(transition.outcome, Transition::Outcome::ignored) << where;
          EXPECT_EQ(transition.to, state) << where;
          EXPECT_EQ(transition.action, RunAction::none) << where;
        } else {
          EXPECT_EQ(transition.outcome, Transition::Outcome::unexpected) << where;
          EXPECT_TRUE(transition.to == RunState::stopping || transition.to == RunState::failed) << where;
        }
      }
    }
  }
}

// A guarded pair must be decided for either value of its guard: a dwell_bad that matches nothing would be lost.
TEST(RunStateMachine, GuardsOfAPairCoverBothCases) {
  for (const TransitionRow& row : transition_table)
    for (RunState state : all_states)
      for (RunEvent event : all_events) {
        if (!row.from.contains(state) || !row.events.contains(event)) continue;
        for (const GuardSet guards : all_guards())
          EXPECT_EQ(taken_rows(state, event, guards), 1) << to_string(state) << " + " << to_string(event);
      }
}

// With the drives on, whatever goes wrong leads to a stop, and from a stop only to failed or aborted.
TEST(RunStateMachine, EveryErrorStopsTheTable) {
  const std::vector<RunEvent> errors = {RunEvent::table_fault, RunEvent::e_stop,         RunEvent::link_lost,
                                        RunEvent::imu_lost,    RunEvent::storage_failed, RunEvent::operator_stop,
                                        RunEvent::end_wanted};
  for (RunState state : all_states) {
    if (!live_states.contains(state)) continue;
    for (RunEvent event : errors) {
      for (const GuardSet guards : all_guards()) {
        const Transition transition = next(state, event, guards);
        EXPECT_EQ(transition.to, RunState::stopping) << to_string(state) << " + " << to_string(event);
        EXPECT_EQ(transition.action, RunAction::stop_table) << to_string(state) << " + " << to_string(event);
      }
    }
    // An event nobody foresaw in this state is no exception.
    EXPECT_EQ(next(state, RunEvent::calibration_ok, usual_guards).to, RunState::stopping) << to_string(state);
  }
  for (RunEvent event : all_events) {
    for (const GuardSet guards : all_guards()) {
      const RunState to = next(RunState::stopping, event, guards).to;
      EXPECT_TRUE(to == RunState::stopping || (is_final(to) && to != RunState::done)) << to_string(event);
    }
  }
}

// What docs/architecture.md has to say, in the order of the table.
template <class Enum>
std::string names_of(EnumSet<Enum> set, const std::vector<Enum>& all) {
  std::string text;
  for (const Enum one : all)
    if (set.contains(one)) text += (text.empty() ? "" : ", ") + std::string(to_string(one));
  return text;
}
std::string names_of(StateSet set) { return set.bits == live_states.bits ? "live" : names_of(set, all_states); }
std::string names_of(EventSet set) {
  const std::string names = names_of(set, all_events);
  return std::ranges::count(names, ',') + 1 == std::ssize(all_events) ? "every event" : names;
}

// In the order of RunGuard.
constexpr const char* guard_names[] = {
    "", "rest_due", "no_rest_due", "repeats_left", "no_repeats_left", "by_operator", "by_error", "by_interruption"};

std::vector<std::string> expected_document_lines() {
  std::vector<std::string> lines;
  for (const TransitionRow& row : transition_table) {
    const std::string guard = guard_names[std::size_t(row.guard)];
    lines.push_back("| " + names_of(row.from) + " | " + names_of(row.events) + " | " + guard + " | " +
                    std::string(to_string(row.to)) + " | " + std::string(to_string(row.action)) + " |");
  }
  for (const IgnoredRow& row : ignored_events)
    lines.push_back("| " + names_of(row.in) + " | " + names_of(row.events) + " | " + std::string(row.why) + " |");
  // The drawing has one arrow a state and event of a row; errors of the live states are drawn from the frame around them.
  for (const TransitionRow& row : transition_table) {
    const std::string name = guard_names[std::size_t(row.guard)];
    const std::string guard = name.empty() ? "" : " [" + name + "]";
    for (RunEvent event : all_events) {
      if (!row.events.contains(event)) continue;
      const std::string arrow = " --> " + std::string(to_string(row.to)) + ": " + to_string(event) + guard;
      if (row.from.bits == live_states.bits) {
        lines.push_back("live" + arrow);
        continue;
      }
      for (RunState state : all_states)
        if (row.from.contains(state)) lines.push_back(to_string(state) + arrow);
    }
  }
  return lines;
}

TEST(RunStateMachine, DocumentListsExactlyTheTable) {
  const std::string text = file_text(TURNCAL_SOURCE_DIR "/docs/architecture.md");
  const std::size_t begin = text.find("\n## The state machine of a run\n");
  std::istringstream file(text.substr(begin, text.find("\n## ", begin + 1) - begin));
  std::multiset<std::string> found;
  for (std::string line; std::getline(file, line);) {
    line.erase(0, line.find_first_not_of(' ') == std::string::npos ? 0 : line.find_first_not_of(' '));
    const bool row = line.starts_with("| ") && !line.starts_with("| from |") && !line.starts_with("| in |") &&
                     !line.starts_with("|-");
    const bool arrow = line.find(" --> ") != std::string::npos && !line.starts_with("[*]") &&
                       line.find("--> [*]") == std::string::npos;
    if (row || arrow) found.insert(line);
  }
  std::multiset<std::string> expected;
  for (const std::string& line : expected_document_lines()) expected.insert(line);
  for (const std::string& line : expected) EXPECT_EQ(found.count(line), expected.count(line)) << "missing: " << line;
  for (const std::string& line : found) EXPECT_EQ(expected.count(line), found.count(line)) << "too many: " << line;
}

}  // namespace
}  // namespace turncal
