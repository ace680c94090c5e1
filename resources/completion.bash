# SphereCal: eval "$(spherecal completion {shell})", or save this where your shell looks for completions.
_spherecal() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" at="" word i
  local -A words options choices
{tables}
  for ((i = 1; i < COMP_CWORD; i++)); do
    word="${{COMP_WORDS[i]}}"
    [[ " ${{words[_$at]}} " == *" $word "* ]] && at="${{at:+$at }}$word"
  done
  COMPREPLY=()
  if [[ -n "${{choices[_$at $before]}}" ]]; then
    COMPREPLY=($(compgen -W "${{choices[_$at $before]}}" -- "$current"))
  elif [[ "$current" == -* ]]; then
    COMPREPLY=($(compgen -W "${{options[_$at]}}" -- "$current"))
  elif [[ -n "${{words[_$at]}}" ]]; then
    COMPREPLY=($(compgen -W "${{words[_$at]}}" -- "$current"))
  fi
}}
complete -o bashdefault -o default -F _spherecal spherecal
