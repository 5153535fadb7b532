// The report of a shift as a document, and its tables as CSV.
#pragma once

#include <string>

#include "orchestrator/line/shift_report.h"
#include "orchestrator/report/document.h"

namespace turncal {

Document shift_document(const ShiftReport& report);
std::string shift_csv(const ShiftReport& report);  // table,item,quantity,value: what stands in the document's tables
std::string signals_csv(const ShiftReport& report);

}  // namespace turncal
