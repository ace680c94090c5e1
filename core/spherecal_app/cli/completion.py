"""`spherecal completion`: scripts for shells, from the parser itself: commands, options and the choices of options."""

import argparse

from spherecal.base.resources import resource_path
from spherecal_app.cli.exit_codes import DONE
from spherecal_app.cli.options import make_parser
from spherecal_app.cli.parsing import parsers_below

_BASH = resource_path("completion.bash").read_text(encoding="utf-8")
_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"


def completion(options: argparse.Namespace) -> int:
    """`spherecal completion`."""
    print(script(make_parser(), options.shell), end="")
    return DONE


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for a shell."""
    if shell == "fish":
        return _fish(parser)
    lines = []
    for words, one in parsers_below(parser):
        at = "_" + " ".join(words)
        options, below = [], []
        for action in one._actions:
            if isinstance(action, argparse._SubParsersAction):
                below += list(action.choices)
                continue
            if action.help == argparse.SUPPRESS:
                continue
            options += action.option_strings
            chosen = " ".join(map(str, action.choices or ()))
            if chosen and not action.option_strings:
                below += chosen.split()
            lines += [f'  choices["{at} {name}"]="{chosen}"' for name in action.option_strings if chosen]
        lines.append(f'  options["{at}"]="{" ".join(options)}"')
        if below:
            lines.append(f'  words["{at}"]="{" ".join(below)}"')
    made = _BASH.format(shell=shell, tables="\n".join(lines))
    # zsh splits neither unquoted words nor counts from 0 unless an option asks for it
    return made if shell == "bash" else _ZSH + made.replace("_spherecal() {", "_spherecal() {\n  emulate -L ksh", 1)


def _fish(parser: argparse.ArgumentParser) -> str:
    lines = ["# SphereCal: spherecal completion fish > ~/.config/fish/completions/spherecal.fish"]
    for words, one in parsers_below(parser):
        seen = [f"__fish_seen_subcommand_from {word}" for word in words]
        for action in one._actions:
            if isinstance(action, argparse._SubParsersAction):
                under = [*seen, f"not __fish_seen_subcommand_from {' '.join(action.choices)}"]
                lines += [
                    f"complete -c spherecal -f -n '{'; and '.join(under)}' -a {name} -d {_quoted(inner.description)}"
                    for name, inner in action.choices.items()
                ]
                continue
            names = [f"-{'l' if name.startswith('--') else 's'} {name.lstrip('-')}" for name in action.option_strings]
            if not names or action.help == argparse.SUPPRESS:
                continue
            takes = f" -x -a '{' '.join(map(str, action.choices))}'" if action.choices else ""
            takes = takes or (" -r" if action.nargs != 0 else "")
            when = f" -n '{'; and '.join(seen)}'" if seen else ""
            lines.append(f"complete -c spherecal{when} {' '.join(names)}{takes} -d {_quoted(action.help)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str | None) -> str:
    short = (text or "").replace("%%", "%").split(";")[0][:80]
    return "'" + short.replace("\\", "").replace("'", "") + "'"
