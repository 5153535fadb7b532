#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <iostream>

#include "imu_io/base/console.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/jobs/command_context.h"
#include "orchestrator/watch/operator_screen.h"
#include "orchestrator/watch/progress.h"

namespace {

// Opens closed descriptors 0 to 2 on /dev/null. Otherwise the next file opened would get one of them, and output would go into it.
bool open_closed_descriptors() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(fd, F_GETFD) == -1 && ::open("/dev/null", O_RDWR) != fd) return false;
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (!open_closed_descriptors()) return turncal::exit_code(turncal::ErrorKind::internal);
  std::signal(SIGPIPE, SIG_IGN);              // a reader that goes away ends the printing, not the work
  std::signal(SIGXFSZ, SIG_IGN);              // a file above its size limit is an error, as on a full disk
  ::umask(::umask(0) | (S_IWGRP | S_IWOTH));  // everybody may read results, only their owner may write them
  const turncal::Console out(std::cout, STDOUT_FILENO), err(std::cerr, STDERR_FILENO);
  turncal::allow_colour(std::cout, STDOUT_FILENO);
  turncal::allow_colour(std::cerr, STDERR_FILENO);
  const int columns = turncal::stdout_size().columns;
  turncal::CommandContext context{.out = std::cout,
                                  .err = std::cerr,
                                  .out_is_terminal = isatty(STDOUT_FILENO) == 1,
                                  .terminal_columns = columns > 0 ? columns : 80};
  return turncal::run_command_line(
      argc, argv,
      {
          {"Station",
           {turncal::add_run_command, turncal::add_resume_command, turncal::add_campaign_command,
            turncal::add_check_command, turncal::add_commission_command, turncal::add_monitor_command,
            turncal::add_twin_command, turncal::add_verify_command, turncal::add_journal_command}},
          {"Data",
           {turncal::add_import_command, turncal::add_export_command, turncal::add_segment_command,
            turncal::add_apply_command, turncal::add_convert_command}},
          {"Analysis",
           {turncal::add_calibrate_command, turncal::add_diagnose_command, turncal::add_allan_command,
            turncal::add_thermal_command, turncal::add_navigate_command, turncal::add_predict_command,
            turncal::add_design_command}},
          {"Line",
           {turncal::add_batch_command, turncal::add_queue_command, turncal::add_serve_command,
            turncal::add_shift_command, turncal::add_fleet_command, turncal::add_recalibrate_command}},
          {"Records", {turncal::add_history_command, turncal::add_certificate_command, turncal::add_records_command}},
      },
      context);
}
