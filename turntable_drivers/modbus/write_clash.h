// Writes that would do more than they are called, and a heartbeat that takes a stop back: a `setup`, `heartbeat`, `stop`, `abort` or `clear_fault` that writes what enables a drive,
// homes or moves it, and axes that cannot be told apart. A pure function of the map.
//
// What starts something is the register that its list writes last: for `enable` the value that it ends with (those before are steps of
// the drive's own state machine), for `home` and `move` every value written there. A 0 that follows another value in a register is a
// release, and starts nothing. The register of a move's position or distance is written by no other list, whatever the value: a drive that
// is on may follow it. Bits of a control word do what they do whatever stands beside them: a word that holds all bits of such a value counts
// as that value (where a drive is on without any bit: a word without those that `abort` leaves), but in a register of command numbers
// (`write.codes`). A brake may hold the drive on, with other bits. A stop or abort of one axis writes to no register of another alone. All of
// it register by register: a number of 32 bits writes two. A register that both lists write with different values first, as a command
// block does, tells them apart.
#pragma once

#include <optional>
#include <string>

#include "turntable_drivers/modbus/register_map.h"

namespace turncal {

struct WriteClash {
  std::string key;  // of the map
  std::string expected;
};
std::optional<WriteClash> write_clash(const RegisterMap& map);

// Whether the word that a stop leaves in the register of `enable` holds all bits of the value that enables.
bool stop_holds_enable(const RegisterMap& map);

}  // namespace turncal
