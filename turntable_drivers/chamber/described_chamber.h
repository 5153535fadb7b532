// A chamber that a .chamber file describes, over registers (Modbus TCP, RTU) or sentences (serial, TCP), and its driver. docs/thermal.md
// lists the keys; turntable_drivers/chamber/chambers/ has two. Link, framing, draining, retries and line sources (LineSource) are those of
// tables (table_line.h, register_codec.h, sentence_codec.h).
//
//   read.actual = 100 s16              registers: ADDRESS TYPE, one request per reading
//   read.actual = TEMP?                sentences: the request, and its answer with one {value}
//   read.actual.expect = {value},{*}
//
// Not modelled: several channels, ramps that only the chamber's own programs have (without write.ramp the chamber chooses its rate).
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "turntable_drivers/ascii/sentence_codec.h"
#include "turntable_drivers/chamber/chamber.h"
#include "turntable_drivers/modbus/register_codec.h"
#include "turntable_drivers/table/table_line.h"

namespace turncal {

enum class ChamberItem { actual, set_point, on, door, alarm, tell_set_point, tell_ramp, switch_on, switch_off };
inline constexpr int chamber_item_count = 9;
constexpr std::size_t index(ChamberItem item) { return std::size_t(item); }
extern const std::array<const char*, chamber_item_count> chamber_keys;  // "read.actual" ... "write.off"
constexpr bool is_command(ChamberItem item) { return item >= ChamberItem::switch_on; }
constexpr bool is_read(ChamberItem item) { return item <= ChamberItem::alarm; }
constexpr bool is_flag(ChamberItem item) { return item >= ChamberItem::on && item <= ChamberItem::alarm; }

struct ChamberEntry {
  double scale = 1.0;                    // units of the device per C, or per C/min
  std::vector<std::string> true_values;  // of a flag; empty: true if any masked bit is set (registers)
  // registers
  RegisterField field;
  std::uint16_t mask = 0xFFFF;
  WriteList writes;  // of a command
  // sentences
  SentenceTemplate send;
  std::optional<SentenceTemplate> expect;
};

struct ChamberDescription : DeviceDescription {
  enum class Language { rig, registers, sentences };  // rig: for dry runs only
  Language language = Language::rig;
  ModbusLinkSettings modbus;
  DialectLink ascii;
  int unit = 1, read_function = 3, write_function = 6;
  WordLayout layout;
  int decimals = 1;  // of numbers in sentences
  ChamberLimits limits;
  std::array<std::optional<ChamberEntry>, chamber_item_count> entries;

  const std::optional<ChamberEntry>& of(ChamberItem item) const { return entries[index(item)]; }
  bool by_registers() const { return language == Language::registers; }
  const TableLinkSettings& link() const {
    return by_registers() ? static_cast<const TableLinkSettings&>(modbus) : ascii;
  }
  void reach(const std::string& address) { modbus.address = ascii.address = address; }
};

Result<ChamberDescription> read_chamber(const std::string& path);
Result<ChamberDescription> parse_chamber(const std::string& text, const std::string& file_name);
// Returns what is sent and read, to compare with the manual.
std::vector<TableRow> explain(const ChamberDescription& chamber);
// True for a line that switches the heaters or reports whether they are on.
bool decides_heat(std::string_view key);

// True if a device's word sets the flag.
bool says_true(const ChamberEntry& entry, const std::string& word);
// Returns the registers of a write.
std::vector<std::uint16_t> words_of(const ChamberDescription& chamber, const WriteStep& step);

class ChamberCodec;

class DescribedChamber : public Chamber {
 public:
  explicit DescribedChamber(const ChamberDescription& description);
  ~DescribedChamber() override;  // switches off what was switched on and was not read off since

  Status connect() override;
  std::string identity() const override;
  const ChamberLimits& limits() const override { return chamber_.limits; }
  Result<ChamberStatus> status() override;
  Status set(double temperature_c, double ramp_c_per_min) override;
  Status on() override { return switched(ChamberItem::switch_on); }
  Status off() override { return switched(ChamberItem::switch_off); }
  void disconnect() override { line_.close(); }

 private:
  // Makes one exchange and returns its answer, a number or a word. Readings are repeated, commands are not.
  Result<std::string> exchange(ChamberItem item, const std::string& body, bool again);
  Result<std::string> read(ChamberItem item);
  Status tell(ChamberItem item, double value);
  Status switched(ChamberItem item);
  Error about(ChamberItem item, const std::string& what) const;

  const ChamberDescription chamber_;
  const StopSignal never_;  // no other thread stops waits on this line
  std::unique_ptr<ChamberCodec> codec_;
  TableLine line_;
  bool may_be_on_ = false;  // switched on, and not read off since
};

}  // namespace turncal
