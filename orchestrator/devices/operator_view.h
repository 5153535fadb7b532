// Where the operator of a table turned by hand looks: the page, and the terminal where it takes a screen. Of another table nothing is shown.
#pragma once

#include <optional>
#include <ostream>
#include <string_view>

#include "orchestrator/devices/operator_prompts.h"
#include "orchestrator/watch/operator_screen.h"
#include "orchestrator/watch/status_page.h"

namespace turncal {

class OperatorView {
 public:
  // prompts: null where nobody turns. screen: `out` is a terminal, and lines are not wanted. All must outlive the view.
  OperatorView(OperatorPrompts* prompts, LiveStatus& live, std::ostream& out, std::string_view tag, bool screen);
  ~OperatorView() { end(); }
  OperatorView(const OperatorView&) = delete;
  OperatorView& operator=(const OperatorView&) = delete;
  bool on_terminal() const { return terminal_.has_value(); }
  void end(bool done, const std::string& resume);  // what stays on the screen: done, or which folder is to be resumed
  void end();                                      // what is printed next stands below

 private:
  OperatorPrompts* prompts_;
  std::optional<OperatorTerminal> terminal_;
};

}  // namespace turncal
