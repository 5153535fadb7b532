# bash completion of turncal. Commands, actions, options and the words that an option takes are those of --help: nothing is listed here.
_turncal() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} help word
  local -a command=()
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    [[ $word == help ]] || command+=("$word")
    [[ $word != -* ]] || break
  done
  # What stands behind a command is a command of its own (records check), or a word that it takes; --help of the first is enough then.
  help=$("${COMP_WORDS[0]}" "${command[@]:0:2}" --help 2> /dev/null) ||
    help=$("${COMP_WORDS[0]}" "${command[@]:0:1}" --help 2> /dev/null)
  if [[ $previous == --* ]]; then  # "--method TEXT:{joint,closed-form}"
    word=$(sed -n "s/^  *\(-[a-zA-Z],\)\{0,1\}$previous [A-Z]*:{\([^}]*\)}.*/\2/p" <<< "$help" | tr , ' ')
  elif [[ $current == -* ]]; then
    word=$(sed -n 's/^  *\(-[a-zA-Z],\)\{0,1\}\(--[a-z-]*\).*/\2/p' <<< "$help")
  elif [[ ${#command[@]} -lt 2 ]]; then
    word=$(sed -n -e '/^Examples/,$d' -e '/^Positionals/,/^$/ s/^  action [A-Z]*:{\([^}]*\)}.*/\1/p' -e '/^Positionals/,/^$/d' \
               -e 's/^  \([a-z]\{1,\}\) .*/\1/p' <<< "$help" | tr , ' ')
  else
    word=""
  fi
  COMPREPLY=($(compgen -W "$word" -- "$current"))
}
# What is no option is a file or a folder.
complete -o default -F _turncal turncal
