// What the program ends with for each kind of error. 0: all is well.
#pragma once

#include "calib/types/status.h"

namespace turncal {

constexpr int exit_code(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::input: return 1;
    case ErrorKind::unit_failed: return 20;
    case ErrorKind::aborted: return 30;
    case ErrorKind::device: return 50;
    case ErrorKind::internal: return 70;
    case ErrorKind::interrupted: return 75;
  }
  return 70;
}

}  // namespace turncal
