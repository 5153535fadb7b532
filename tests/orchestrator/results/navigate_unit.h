// The fixture is in rig_unit.h.
#pragma once

#include "tests/orchestrator/results/rig_unit.h"
