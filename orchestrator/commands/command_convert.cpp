// `turncal convert PARAMETERS --header FILE --binary FILE --yaml FILE`: a parameter file in other forms (docs/parameter-forms.md).
#include <memory>

#include "imu_io/base/atomic_file.h"
#include "imu_io/recordings/parameter_forms.h"
#include "orchestrator/commands/commands.h"
#include "orchestrator/records/output_folder.h"

namespace turncal {

namespace {

struct ConvertOptions {
  std::string parameters;
  std::string header;
  std::string binary;
  std::string yaml;
};

Status convert(const ConvertOptions& options, CommandContext& context) {
  if (options.header.empty() && options.binary.empty() && options.yaml.empty())
    return input_error("expected --header, --binary or --yaml, or several of them");
  if (Status status = check_apart({{"the parameter file", options.parameters},
                                   {"--header", options.header},
                                   {"--binary", options.binary},
                                   {"--yaml", options.yaml}});
      !status)
    return status;
  const ParameterFile file = TRY(read_parameter_file(options.parameters));
  // An existing file is replaced by one that begins alike.
  constexpr std::size_t alike = 30, of_block = 4;
  std::vector<NamedText> forms;
  if (!options.header.empty()) forms.push_back({options.header, format_parameter_header(file)});
  if (!options.yaml.empty()) forms.push_back({options.yaml, format_parameter_yaml(file)});
  if (!options.binary.empty()) forms.push_back({options.binary, format_parameter_block(file)});
  for (const NamedText& form : forms) {
    const std::size_t same = form.path == options.binary ? of_block : alike;
    TRY(check_replaceable(form.path, std::string_view(form.content).substr(0, same)));
  }
  TRY(write_files_atomically(forms));
  for (const NamedText& form : forms) context.out << "written  " << form.path << '\n';
  return {};
}

}  // namespace

void add_convert_command(CommandLine& line, CommandContext& context) {
  const auto options = std::make_shared<ConvertOptions>();
  const Command command = line.command("convert", "a parameter file as C header, binary block or YAML");
  command.option("parameters", options->parameters, "parameter file").required();
  command.option("--header", options->header, "C header to write");
  command.option("--binary", options->binary, "binary block with a checksum to write");
  command.option("--yaml", options->yaml, "YAML file to write");
  command.runs(context, [options, &context] { return convert(*options, context); });
}

}  // namespace turncal
