# bash completion of turncal. Commands, options and the words that an option takes are those of --help: nothing is listed here.
_turncal() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} command="" help word
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    [[ $word == -* ]] || { command=$word; break; }
  done
  if [[ -z $command ]]; then
    help=$("${COMP_WORDS[0]}" --help 2> /dev/null)
    word=$(sed -n '/^Subcommands/,$ s/^  *\([a-z]\{1,\}\) .*/\1/p' <<< "$help")
  else
    help=$("${COMP_WORDS[0]}" "$command" --help 2> /dev/null)
    word=""
    # "--method TEXT:{joint,closed-form}"
    if [[ $previous == --* ]]; then
      word=$(sed -n "s/^  *\(-[a-z],\)\{0,1\}$previous [A-Z]*:{\([^}]*\)}.*/\2/p" <<< "$help" | tr , ' ')
      COMPREPLY=($(compgen -W "$word" -- "$current"))
      [[ -z $word ]] || return 0
    fi
  fi
  if [[ $current == -* ]]; then
    word=$(sed -n 's/^  *\(-[a-z],\)\{0,1\}\(--[a-z-]*\).*/\2/p' <<< "$help")
  fi
  COMPREPLY=($(compgen -W "$word" -- "$current"))
}
# What is no option is a file or a folder.
complete -o default -F _turncal turncal
