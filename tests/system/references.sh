#!/usr/bin/env bash
# Says which references of the tree given as $1 are dead, one line each; exit code 1 if any. What is looked at:
#   comments and documents: every path that begins with a folder of ours exists, and every file with the ending of a source, a
#     document or a description; every key of a configuration, `key = value` or `dotted.key`, stands in the sources, and every
#     variable TURNCAL_... in what reads the environment
#   Markdown: every relative link resolves, to a heading too; every `Class::member` stands in some header
#   Markdown, given the program as $2: every `turncal COMMAND` and every --option is in its --help or in a script
set -euo pipefail
root=$(cd "$1" && pwd)
program=${2:+$(realpath "$2")}
cd "$root"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

find . \( -name .git -o -path ./build \) -prune -o -print | sed 's|^\./||' > "$work/tree"
grep -E '\.(h|cpp|md|sh|cmake|in|seq|station|map|dialect|frame|py)$|CMakeLists\.txt$|^scripts/.|^\.ci/.|\.clang-' "$work/tree" |
  while read -r path; do if [ -f "$path" ]; then echo "$path"; fi; done > "$work/texts"
# Words of all headers, for `Class::member`.
{ grep -E '\.h$' "$work/tree" || true; } | xargs -r grep -ohE '[A-Za-z_][A-Za-z0-9_]*' | sort -u > "$work/words"

# Words of the sources without their comments, and of the files that they read, for keys.
{ grep -E '\.(h|cpp|in|frame|map|dialect|station|seq)$' "$work/tree" || true; } | xargs -r cat |
  sed -E 's%(^|[[:space:]])//.*%%' | grep -aoE '[A-Za-z_][A-Za-z0-9_]*' | sort -u > "$work/code"

# Variables of the environment that something reads.
{ grep -E '\.(md)$' -v "$work/texts" || true; } | xargs -r cat | sed -E 's%(^|[[:space:]])(//|#).*%%' |
  { grep -aoE 'TURNCAL_[A-Z_]*[A-Z]' || true; } | sort -u > "$work/variables"

# Options by command: "run --out" a line, and "any --out" for every command and script.
: > "$work/options"
if [ -n "$program" ]; then
  listed() { "$program" "$@" --help | sed -n -e '/^Examples/,$d' -e '/^Positionals/,/^$/d' -e 's/^  \([a-z]\{1,\}\) .*/\1/p'; }
  listed > "$work/commands"
  while read -r command; do
    { "$program" "$command" --help; for action in $(listed "$command"); do "$program" "$command" "$action" --help; done; } | { grep -oE -e '(^|[ ,(])--[a-z][a-z-]*' || true; } | sed "s/.*--/$command --/"
  done < "$work/commands" > "$work/options"
  "$program" --help | { grep -oE -e '(^|[ ,(])--[a-z][a-z-]*' || true; } | sed 's/.*--/turncal --/' >> "$work/options"
  sed 's/^[a-z]* /any /' "$work/options" > "$work/any"
  { grep -rsohE -e '--[a-z][a-z_-]*' scripts benchmarks || true; } | sed 's/^/any /' >> "$work/any"
  # Of other people's programs that the documents call.
  printf 'any --%s\n' gtest_filter preset install data-binary mail-rcpt >> "$work/any"
  cat "$work/any" >> "$work/options"
else
  : > "$work/commands"
fi

awk -v work="$work" -v with_program="${program:+1}" '
  function bad(why) { print FILENAME ":" FNR ": " why; failed = 1 }
  function bare(path) { sub(/.*\//, "", path); return path }
  # What `path` means to a file of `folder`, without "..". Empty where it leads out of the tree.
  function joined(folder, path,    part, i, n, kept, text) {
    n = split((folder == "" ? "" : folder "/") path, part, "/")
    for (i = 1; i <= n; ++i) {
      if (part[i] == "" || part[i] == ".") continue
      if (part[i] == "..") { if (kept-- < 1) return ""; continue }
      stack[++kept] = part[i]
    }
    for (i = 1; i <= kept; ++i) text = text (i > 1 ? "/" : "") stack[i]
    return text
  }
  function there(path,    pattern, other) {
    sub(/\/+$/, "", path)
    if (path in exists) return 1
    if (path !~ /[*]/) return 0
    pattern = path
    gsub(/[.]/, "[.]", pattern); gsub(/[*]/, "[^/]*", pattern)
    for (other in exists) if (other ~ "^" pattern "$") return 1
    return 0
  }
  # A path, perhaps with * or {this,that} in it.
  function look_at(token,    open, shut, part, i, n) {
    open = index(token, "{"); shut = index(token, "}")
    if (open && shut > open) {
      n = split(substr(token, open + 1, shut - open - 1), part, ",")
      for (i = 1; i <= n; ++i) look_at(substr(token, 1, open - 1) part[i] substr(token, shut + 1))
      return
    }
    sub(/[.,-]+$/, "", token)
    if (token ~ /[<>{},]/ || token ~ /^[\/]/ || token ~ /^build\//) return
    if (token ~ /^(calib|imu_io|turntable_drivers|sequences|orchestrator|tests|docs|scripts|packaging|[.]ci)\/./) {
      if (!there(token) && !there(joined(folder, token))) bad("no " token)
    } else if (token ~ /\/.*[.](h|cpp|md|sh|seq|station|map|dialect|frame)$/) {
      if (token ~ /^[.][.]\// && joined(folder, token) == "") return
      if (!there(joined(folder, token)) && !there(token) && !foreign(token)) bad("no " token)
    } else if (token ~ /^[A-Za-z0-9_.*-]+[.](h|cpp|md|sh|station|map|dialect|frame|seq)$/ && token !~ /^[.*]/) {
      if (!named(token) && !there(joined(folder, token)) && !foreign(token) && !of_reader(token)) bad("no file named " token)
    } else if (token ~ /^TURNCAL_[A-Z_]*[A-Z]$/ && !(token in variables)) {
      bad("no variable " token)
    }
  }
  function named(token,    pattern, other) {
    if (token in known || (token ".in") in known) return 1
    if (token !~ /[*]/) return 0
    pattern = token
    gsub(/[.]/, "[.]", pattern); gsub(/[*]/, ".*", pattern)
    for (other in known) if (other ~ "^" pattern "$") return 1
    return 0
  }
  # Descriptions that a document lets its reader make, and keys with such an ending.
  function of_reader(token) { return token ~ /^(my|x|k|FILE|NAME|forty|twenty|extra|rehearsal|table|imu|record|leg[.][0-9N])[.][a-z]+$/ }
  function foreign(token) { return token ~ /^(sys|linux|asm|Eigen)\// || token ~ /^(time|unistd|fcntl|termios|math|modbus|sqlite3|libpq-fe|httplib)[.]h$/ }
  function look_at_words(text,    token, i, n) {
    gsub(/[a-z]+:\/\/[^ )>"]+/, " ", text)
    gsub(/\$[A-Za-z]+\//, " ", text)  # of a shell: $here/calib
    gsub(/[^A-Za-z0-9_.\/*{}<>,-]/, " ", text)
    n = split(text, token, " ")
    for (i = 1; i <= n; ++i) look_at(token[i])
  }
  # What a heading is called in a link to it: small letters, digits, _ and - for a blank.
  function read_headings(file,    line, block, slug) {
    while ((getline line < file) > 0) {
      if (line ~ /^ *```/) block = !block
      if (block || !sub(/^#+ +/, "", line)) continue
      slug = tolower(line)
      gsub(/\]\([^)]*\)/, "", slug); gsub(/[][!-,.\/:-@\\^`{-~]/, "", slug); gsub(/ /, "-", slug)
      anchors[file "#" slug (slug in of_file ? "-" of_file[slug] : "")] = 1
      ++of_file[slug]
    }
    close(file)
    split("", of_file)
  }
  function look_at_links(text,    target, heading, file) {
    while (match(text, /\]\([^)]*\)/)) {
      target = substr(text, RSTART + 2, RLENGTH - 3)
      text = substr(text, RSTART + RLENGTH)
      if (target ~ /^[a-z]+:/) continue
      heading = index(target, "#") ? substr(target, index(target, "#") + 1) : ""
      sub(/#.*/, "", target)
      file = target == "" ? FILENAME : joined(folder, target)
      if (!there(file)) bad("link to " target)
      else if (heading != "" && file ~ /[.]md$/ && !((file "#" heading) in anchors)) bad("link to " target "#" heading)
    }
  }
  function look_at_images(text,    target) {
    while (match(text, /src="[^"]*"/)) {
      target = substr(text, RSTART + 5, RLENGTH - 6)
      text = substr(text, RSTART + RLENGTH)
      if (target !~ /^[a-z]+:/ && !there(joined(folder, target))) bad("link to " target)
    }
  }
  # Text between backquotes: a key of some configuration?
  function look_at_key(text,    part, i, n) {
    if (text !~ /^[a-z][a-z0-9_]*([.][a-zA-Z0-9_]+)*( = .*)?$/ || text !~ /[.]| = /) return
    if (text ~ /[.](h|cpp|sh|md)$/ || (text in known) || text ~ /^system[.]/) return  # a file, or a test
    sub(/ = .*/, "", text)
    if (text !~ /[.]/ && length(text) < 8) return  # a formula
    n = split(text, part, ".")
    for (i = 1; i <= n; ++i) if (part[i] ~ /^[a-z][a-z_]*[a-z]$/ && !(part[i] in code)) { bad("no key " text); return }
  }
  function look_at_quoted(text, documents,    quoted) {
    while (match(text, /`[^`]+`/)) {
      quoted = substr(text, RSTART + 1, RLENGTH - 2)
      text = substr(text, RSTART + RLENGTH)
      look_at_key(quoted)
      if (documents) look_at_code(quoted)
    }
  }
  # Text between backquotes in a document, or a whole line of a code block.
  function look_at_code(text,    words, i, n, command, options, pair) {
    if (text ~ /^[A-Za-z]+::[A-Za-z_]+(\(\))?$/) {
      sub(/\(\)/, "", text)
      split(text, pair, "::")
      if (!(pair[1] in word) || !(pair[2] in word)) bad("no " text " in any header")
    }
    if (!with_program) return
    sub(/ # .*/, "", text)
    command = "any"
    n = split(text, words, /[ \t]+/)
    for (i = 1; i <= n; ++i) {
      if (words[i] ~ /(^|\/)turncal$/ && words[i + 1] ~ /^[a-z]+$/) {
        command = words[++i]
        if (!(command in commands)) { bad("no command turncal " command); command = "any" }
      } else if (words[i] == "|" || words[i] == ";" || words[i] == "&&") {
        command = "any"
      } else if (match(words[i], /^--[a-z][a-z_-]*/)) {
        words[i] = substr(words[i], 1, RLENGTH)
        if (!((command " " words[i]) in options_of)) bad("no option " words[i] (command == "any" ? "" : " of turncal " command))
      }
    }
  }
  BEGIN {
    while ((getline line < (work "/tree")) > 0) { exists[line] = 1; known[bare(line)] = 1 }
    while ((getline line < (work "/words")) > 0) word[line] = 1
    while ((getline line < (work "/code")) > 0) code[line] = 1
    while ((getline line < (work "/commands")) > 0) commands[line] = 1
    while ((getline line < (work "/options")) > 0) options_of[line] = 1
    while ((getline line < (work "/variables")) > 0) variables[line] = 1
    while ((getline line < (work "/texts")) > 0) if (line ~ /[.]md$/) read_headings(line)
  }
  FNR == 1 { folder = FILENAME; if (!sub(/\/[^\/]*$/, "", folder)) folder = ""; block = 0 }
  FILENAME ~ /[.]md$/ {
    if (/^ *```/) { block = !block; next }
    look_at_words($0)
    if (!block) { look_at_links($0); look_at_images($0) }
    if (block) { look_at_code($0); next }
    look_at_quoted($0, 1)
    next
  }
  FILENAME ~ /[.](h|cpp|in)$/ {
    if (!match($0, /(^|[ \t])\/\/ ?/)) next
    text = substr($0, RSTART + RLENGTH)
    look_at_words(text)
    look_at_quoted(text, 0)
    next
  }
  { if (match($0, /(^|[ \t])#/) && !/^#!/) look_at_words(substr($0, RSTART + RLENGTH)) }
  END { exit failed }' $(cat "$work/texts")
