// Faults of a line, each injected at the twin, over every line and codec: what comes out is the right position or an error, never a garbled
// number, never another axis's position. Stops: stop_states_test.cpp.

#include "tests/turntable_drivers/served_twin.h"

namespace turncal {
namespace {

enum Line { tcp = 1, rtu = 2, text = 4, registers = tcp | rtu, every = registers | text };

struct LineFault {
  const char* name;
  std::function<void(AnswerPlan& plan, Line line)> how;  // of one reply
  Line on = every;
};

std::function<void(AnswerPlan&, Line)> cut_at(std::ptrdiff_t at, double delay_s) {
  return [=](AnswerPlan& plan, Line) { cut(plan, at, delay_s); };
}

std::function<void(AnswerPlan&, Line)> as_text(const std::function<std::string(std::string)>& how) {
  return [how](AnswerPlan& plan, Line) {
    const std::string changed = how({bytes_of(plan).begin(), bytes_of(plan).end()});
    bytes_of(plan).assign(changed.begin(), changed.end());
  };
}

std::vector<LineFault> line_faults() {
  const auto late = [](double delay_s) {
    return [delay_s](AnswerPlan& plan, Line) { plan.pieces[0].delay_s = delay_s; };
  };
  const auto twice = [](double delay_s) {
    return [delay_s](AnswerPlan& plan, Line) { plan.pieces.push_back({bytes_of(plan), delay_s}); };
  };
  const auto byte_by_byte = [](AnswerPlan& plan, Line line) {
    const Frame all = bytes_of(plan);
    plan.pieces.clear();
    for (const std::uint8_t byte : all) plan.pieces.push_back({{byte}, line == text ? 0.001 : 0.002});
  };
  const auto shorter_by = [](std::size_t bytes) {
    return [bytes](AnswerPlan& plan, Line) { bytes_of(plan).resize(bytes_of(plan).size() - bytes); };
  };
  const auto before = [](const Frame& junk) {
    return [junk](AnswerPlan& plan, Line) { bytes_of(plan).insert(bytes_of(plan).begin(), junk.begin(), junk.end()); };
  };
  return {
      {"silence", [](AnswerPlan& plan, Line) { plan.pieces.clear(); }},
      {"late", late(0.2)},
      {"very_late", late(0.33)},
      // Over TCP a flip is in the header (TCP's own checksum guards the data).
      {"flipped_bit", [](AnswerPlan& plan, Line line) { bytes_of(plan)[line == tcp ? 1 : 5] ^= 0x10; }},
      {"cut_short", shorter_by(3)},
      {"half", [](AnswerPlan& plan, Line) { bytes_of(plan).resize(bytes_of(plan).size() / 2); }},
      {"one_byte", [](AnswerPlan& plan, Line) { bytes_of(plan).resize(1); }},
      {"trailing_junk",
       [](AnswerPlan& plan, Line) {
         bytes_of(plan).insert(bytes_of(plan).end(), {0xAA, 0x55, 0x00});
       }},
      {"leading_junk", before({0x00, 0xFF})},
      {"twice", twice(0.0)},
      {"twice_a_little_later", twice(0.005)},
      {"split", cut_at(5, 0.015)},
      {"slow_bytes", byte_by_byte},
      {"another_protocol", [](AnswerPlan& plan, Line) { bytes_of(plan)[3] = 7; }, tcp},
      {"another_unit", as_text([](std::string said) {
         said[0] = char(1 + said[0] % 3);
         return framed(said.substr(0, said.size() - 2), {});
       }),
       rtu},
      // The adapter sends the request back.
      {"echo",
       as_text([](const std::string& said) { return framed(read_body(said[0], 3, 0x100, said[2] / 2), {}) + said; }),
       rtu},
      {"stalling_bytes", cut_at(7, 0.06), registers},  // longer than the byte time-out
      {"digit_changed", as_text([](std::string said) {
         said[said.find_first_of("0123456789", said.size() / 3)] = 'x';
         return said;
       }),
       text},
      {"not_a_number", as_text([](std::string said) {
         const std::size_t begin = said.find_first_of("-0123456789", 7);
         return said.replace(begin, said.find_first_not_of("-.0123456789", begin) - begin, "nan");
       }),
       text},
      {"no_terminator", shorter_by(2), text},
      {"interleaved", before({'$', 'A', 'S', '\r', '\n'}), text},
      {"control_characters", as_text([](std::string said) { return said.insert(said.size() / 2, "\x01\x7f"); }), text},
  };
}

using LineFaultCase = std::pair<Line, LineFault>;
void PrintTo(const LineFaultCase& one, std::ostream* out) { *out << one.second.name; }

std::vector<LineFaultCase> cases() {
  std::vector<LineFaultCase> all;
  for (const LineFault& fault : line_faults())
    for (const Line line : {tcp, rtu, text})
      if ((fault.on & line) != 0) all.emplace_back(line, fault);
  return all;
}

template <class Table>
void expect_truth_in_spite_of(const LineFaultCase& one, Table& s) {
  int reads = 0;
  s.station.disturb([&](const auto& request, AnswerPlan& plan) {
    if (is_read(request) && (++reads == 4 || reads == 9)) one.second.how(plan, one.first);
  });
  EXPECT_EQ(s.expect_truth(6), 18) << "every disturbed reading is repeated with success: " << s.last_error.message;
  s.station.disturb(nullptr);  // the server stands still meanwhile
  EXPECT_GE(reads, 9) << "both were disturbed; a doubled reply may have answered the last requests before the twin did";
  EXPECT_TRUE(s.driver.stop_all().ok());
}

class LineFaults : public testing::TestWithParam<LineFaultCase> {};

TEST_P(LineFaults, NoWrongPositionIsBelieved) {
  if (GetParam().first == text) {
    TextTable s("own_dollar");
    expect_truth_in_spite_of(GetParam(), s);
  } else {
    FaultStation s(GetParam().first == tcp);
    expect_truth_in_spite_of(GetParam(), s);
  }
}

INSTANTIATE_TEST_SUITE_P(All, LineFaults, testing::ValuesIn(cases()), [](const auto& which) {
  const Line line = which.param.first;
  return std::string(line == tcp ? "tcp_" : line == rtu ? "rtu_" : "text_") + which.param.second.name;
});

}  // namespace
}  // namespace turncal
