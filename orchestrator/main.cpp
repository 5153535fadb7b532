#include <sys/ioctl.h>
#include <unistd.h>

#include <iostream>

#include "orchestrator/commands/commands.h"

namespace {

int terminal_columns() {
  winsize size{};
  return ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

}  // namespace

int main(int argc, char** argv) {
  turncal::CommandContext context{.out = std::cout,
                                  .err = std::cerr,
                                  .out_is_terminal = isatty(STDOUT_FILENO) == 1,
                                  .terminal_columns = terminal_columns()};
  return turncal::run_command_line(argc, argv,
                                   {
                                       turncal::add_run_command,
                                       turncal::add_resume_command,
                                       turncal::add_journal_command,
                                       turncal::add_twin_command,
                                       turncal::add_monitor_command,
                                       turncal::add_commission_command,
                                       turncal::add_check_command,
                                       turncal::add_predict_command,
                                       turncal::add_import_command,
                                       turncal::add_export_command,
                                       turncal::add_segment_command,
                                       turncal::add_calibrate_command,
                                       turncal::add_diagnose_command,
                                       turncal::add_apply_command,
                                       turncal::add_batch_command,
                                       turncal::add_queue_command,
                                       turncal::add_history_command,
                                       turncal::add_restore_command,
                                   },
                                   context);
}
