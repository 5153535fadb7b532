// DialectTwin: a simulated table that speaks the ASCII dialect of a file, with the axes of any Turntable (the rig's mock). It matches
// requests with the templates that the driver fills in, and fills in the templates that the driver matches; modbus_twin.h is
// the same for Modbus. line_server.h shows how to run it.
//
// A sentence that matches no template, or that the table refuses, is answered with the first of error.texts, or not at all.
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

// Removes the next sentence from the front of `bytes` and returns what `answer_of` makes of its body; empty: there is none yet. Bytes that
// are no frame are not answered.
std::optional<AnswerPlan> answer_sentence(
    const DialectLink& link, std::vector<std::uint8_t>& bytes,
    const std::function<std::optional<std::string>(const std::string& body)>& answer_of);

class DialectTwin : public LineServer {
 public:
  DialectTwin(Dialect dialect, Turntable& table)
      : dialect_(std::move(dialect)), table_(table) {}  // the table must outlive the twin

  Status power_on();  // connects to the table and enables it if the dialect has no enable sentence
  std::function<void(const std::string& body, AnswerPlan&)> disturb;

 private:
  using Values = std::map<std::string, std::string>;
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  // Returns the body of the answer; empty: no answer.
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
