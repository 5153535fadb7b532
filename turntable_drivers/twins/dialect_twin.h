// DialectTwin: a simulated table that speaks the ASCII dialect of a file, with the axes of any Turntable (the rig's mock). It matches
// what it is sent against the templates the driver fills in, and fills in the templates the driver matches; modbus_twin.h has
// the same for Modbus. line_server.h says how it is run.
//
// A sentence that no template matches, or that the table refuses, is answered with the first of error.texts, or not at all.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "turntable_drivers/ascii/dialect.h"
#include "turntable_drivers/twins/line_server.h"
#include "turntable_drivers/twins/told_table.h"

namespace turncal {

// The next sentence at the front of `bytes`, which it is taken off, with what `answer_of` says to its body; empty: there is none yet. What
// is no frame is not answered.
std::optional<AnswerPlan> answer_sentence(
    const DialectLink& link, std::vector<std::uint8_t>& bytes,
    const std::function<std::optional<std::string>(const std::string& body)>& answer_of);

class DialectTwin : public LineServer {
 public:
  DialectTwin(Dialect dialect, Turntable& table)
      : dialect_(std::move(dialect)), table_(table) {}  // the table must outlive the twin

  Status power_on();  // connects to the table; a table without an enable sentence comes up enabled
  std::function<void(const std::string& body, AnswerPlan&)> disturb;

 private:
  using Values = std::map<std::string, std::string>;
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  // The body of the answer; empty: none is due.
  std::optional<std::string> answer(const std::string& body);
  std::optional<std::string> answer_of(TableOperation operation, std::size_t step, const Values& values);
  Status move(Axis axis, const Values& values);
  std::string value_of(const std::string& name, Axis axis);
  std::optional<std::string> refusal() const;

  Dialect dialect_;
  ToldTable table_;
  std::array<std::size_t, table_operation_count> progress_{};
  std::array<Values, table_operation_count> pending_;
};

}  // namespace turncal
