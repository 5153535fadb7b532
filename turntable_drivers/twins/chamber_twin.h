// A simulated chamber (any Chamber, such as the rig's) behind the registers or sentences of a .chamber file. line_server.h shows how to run it.
//
// An unknown register is answered with exception 2, an unknown sentence not at all; a refusal of the chamber with exception 4, or not at all.
// A command of several writes takes effect with the last one.
#pragma once

#include <functional>

#include "turntable_drivers/chamber/described_chamber.h"
#include "turntable_drivers/twins/dialect_twin.h"

namespace turncal {

class ChamberTwin : public LineServer {
 public:
  // The chamber must outlive the twin. held: locked while the chamber is used, if another thread lets its time pass; null: the server's mutex.
  ChamberTwin(ChamberDescription description, Chamber& chamber, std::mutex* held = nullptr)
      : described_(std::move(description)), chamber_(chamber), held_(held ? *held : mutex) {}
  std::function<void(bool reads, AnswerPlan&)> disturb;

 private:
  std::optional<AnswerPlan> next_answer(std::vector<std::uint8_t>& bytes) override;
  std::optional<AnswerPlan> next_registers(std::vector<std::uint8_t>& bytes);
  std::optional<std::string> answer(const std::string& body);         // empty: no answer
  double value_of(ChamberItem item, const ChamberStatus& now) const;  // in units of the device
  Status carry_out(ChamberItem item, double value);

  ChamberDescription described_;
  Chamber& chamber_;
  std::mutex& held_;
  double ramp_c_per_min_ = 1.0;
  bool reads_ = true;
};

}  // namespace turncal
