#include "orchestrator/devices/operator_view.h"

#include <unistd.h>

#include "orchestrator/watch/progress.h"

namespace turncal {

OperatorView::OperatorView(OperatorPrompts* prompts, LiveStatus& live, std::ostream& out, std::string_view tag,
                           bool screen)
    : prompts_(prompts) {
  if (!prompts) return;
  if (screen && ::isatty(STDIN_FILENO) == 1 && stdout_size().takes_screen()) {
    // Past the stream: its prefix belongs to lines.
    const auto write = [&out](const std::string& text) {
      if (stdout_takes_more() && out.flush()) static_cast<void>(!::write(STDOUT_FILENO, text.data(), text.size()));
    };
    terminal_.emplace(std::string(tag), write, stdout_size(), wall_utc_s);
  }
  const auto show = [this, &live](const OperatorScreen& now) {
    live.show_operator(now);
    if (terminal_) terminal_->show(now);
  };
  prompts->show_on(show, !terminal_);
}

void OperatorView::end(bool done, const std::string& resume) {
  if (terminal_) terminal_->show(last_screen(done, resume, prompts_->texts()));
  this->end();
}

void OperatorView::end() {
  if (prompts_) prompts_->show_on({}, true);
  terminal_.reset();
}

}  // namespace turncal
