// The faults are in rig_station.h.
#pragma once

#include "tests/orchestrator/rig_station.h"
