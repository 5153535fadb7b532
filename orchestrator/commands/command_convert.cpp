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

// An existing file is replaced by one that begins alike.
Status write_form(const std::string& path, const std::string& content, std::size_t alike, CommandContext& context) {
  if (Status status = check_replaceable(path, std::string_view(content).substr(0, alike)); !status) return status;
  if (Status status = write_file_atomically(path, content); !status) return status;
  context.out << "written  " << path << '\n';
  return {};
}

Status convert(const ConvertOptions& options, CommandContext& context) {
  if (options.header.empty() && options.binary.empty() && options.yaml.empty())
    return input_error("expected --header, --binary or --yaml, or several of them");
  if (Status status = check_apart({{"the parameter file", options.parameters},
                                   {"--header", options.header},
                                   {"--binary", options.binary},
                                   {"--yaml", options.yaml}});
      !status)
    return status;
  const Result<ParameterFile> file = read_parameter_file(options.parameters);
  if (!file) return file.error();
  constexpr std::size_t of_comment = 30, of_block = 4, of_yaml = 30;
  if (!options.header.empty()) {
    if (Status status = write_form(options.header, format_parameter_header(*file), of_comment, context); !status)
      return status;
  }
  if (!options.binary.empty()) {
    const std::vector<std::byte> block = format_parameter_block(block_of(*file));
    const std::string bytes(reinterpret_cast<const char*>(block.data()), block.size());
    if (Status status = write_form(options.binary, bytes, of_block, context); !status) return status;
  }
  if (!options.yaml.empty()) {
    if (Status status = write_form(options.yaml, format_parameter_yaml(*file), of_yaml, context); !status)
      return status;
  }
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
