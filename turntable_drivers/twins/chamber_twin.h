// A simulated chamber (any Chamber, the rig's) behind the registers or sentences of a .chamber file. line_server.h says how it is run.
//
// Registers that no entry names are answered with exception 2, sentences that none matches not at all; what the chamber refuses with exception 4, or
// not at all. Of a command of several writes the last one counts.
#pragma once

#include <functional>

#include "turntable_drivers/chamber/described_chamber.h"
#include "turntable_drivers/twins/dialect_twin.h"

namespace turncal {

class ChamberTwin : public LineServer {
 public:
  // The chamber must outlive the twin. held: while the chamber is used, where somebody else lets its time pass; null: the server's own.
  ChamberTwin(ChamberDescription description, Chamber& chamber, std::mutex* held = nullptr)
      : described_(std::move(description)), chamber_(chamber), held_(held ? *held : mutex) {}
  std::function<void(bool reads, AnswerPlan&)> disturb;

 private:
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  std::optional<AnswerPlan> next_registers(std::vector<std::uint8_t>& bytes);
  std::optional<std::string> answer(const std::string& body);         // empty: none is due
  double value_of(ChamberItem item, const ChamberStatus& now) const;  // in the device's units
  Status carry_out(ChamberItem item, double value);

  ChamberDescription described_;
  Chamber& chamber_;
  std::mutex& held_;
  double ramp_c_per_min_ = 1.0;
  bool reads_ = true;
};

}  // namespace turncal
