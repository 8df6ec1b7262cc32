"""Prompt with commands that can be shortened, repeated, completed and explained, for debugger and replay."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TextIO, TypeVar

from picktree.files import PicktreeError, suggest_name

Out = TypeVar("Out", bound=TextIO)


@dataclass(frozen=True, slots=True)
class Command:
    """Command of a prompt; `run` returns whether it leaves the prompt."""

    usage: str
    help: str
    run: Callable[[str], bool]
    short: str = ""


class CommandPrompt:
    """Prompt that reads commands until one of them leaves it. An empty line repeats the last command.

    `read` shows the text of the prompt and returns a line; it raises EOFError at the end of the input.
    """

    text = "(picktree) "

    def __init__(self, read: Callable[[str], str], out: TextIO) -> None:
        self._read, self._out = read, out
        self._last = ""
        self._commands: dict[str, Command] = {}

    def offer(self, *commands: Command) -> None:
        """Add commands; `help` lists them in this order."""
        self._commands.update({command.usage.split()[0]: command for command in commands})

    def converse(self) -> bool:
        """Run command lines; return False at the end of the input, True when a command left the prompt."""
        while True:
            try:
                line = self._read(self.text).strip() or self._last
            except EOFError:
                return False
            self._last = line
            if line and self.carry_out(line):
                return True

    @contextmanager
    def into(self, out: Out) -> Generator[Out]:
        """Redirect the output to `out` in the block."""
        before, self._out = self._out, out
        try:
            yield out
        finally:
            self._out = before

    def carry_out(self, line: str) -> bool:
        """Run one command. Bad input is reported, not raised."""
        word, _, rest = line.partition(" ")
        name = self._named(word)
        if not name:
            return False
        try:
            return self._commands[name].run(rest.strip())
        except PicktreeError as error:
            self._say(str(error))
        return False

    def completions(self, line: str) -> list[str]:
        """Return the possible completions of a line's last word."""
        word, _, rest = line.lstrip().partition(" ")
        if not rest and not line.endswith(" "):
            return [f"{name} " for name in self._commands if name.startswith(word)]
        commands = self._meant(word)
        if len(commands) != 1:
            return []
        last = rest.split(" ")[-1]
        return sorted(text for text in self.arguments(commands[0]) if text.startswith(last))

    def arguments(self, command: str) -> Iterable[str]:
        return self._commands if command == "help" else ()

    def show_help(self, word: str) -> bool:
        name = self._named(word) if word else ""
        if word and not name:
            return False
        wanted = [self._commands[name]] if name else list(self._commands.values())
        width = max(len(command.usage) for command in wanted)
        lines = [f"{command.usage:<{width}}  {command.help}" for command in wanted]
        if not word:
            lines.append(
                "A command may be shortened; an empty line repeats the last. PATH may be the end "
                "of a node's path."
            )
        return self._show(lines)

    def _named(self, word: str) -> str:
        """Return the command of a word or its beginning; empty, with a message, unless exactly one
        matches."""
        fitting = self._meant(word)
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            self._say(f"{word!r} may be {', '.join(fitting)}")
        else:
            hint = suggest_name(word, self._commands)
            hint = hint if hint.startswith("did you mean") else "`help` lists the commands"
            self._say(f"no command {word!r} ({hint})")
        return ""

    def _meant(self, word: str) -> list[str]:
        """Return the commands that match a word or its beginning."""
        exact = [name for name, command in self._commands.items() if word in (name, command.short)]
        return exact or [name for name in self._commands if name.startswith(word)]

    def _show(self, lines: Iterable[str]) -> bool:
        for line in lines:
            self._say(line)
        return False

    def _say(self, text: str) -> None:
        print(text, file=self._out, flush=True)


def tick_count(text: str) -> int:
    """Return the N of `step [N]`. Raises PicktreeError."""
    if text and not (text.isdecimal() and int(text) > 0):
        raise PicktreeError(f"{text!r} is no number of ticks")
    return int(text or 1)


def line_reader(out: TextIO) -> Callable[[str], str]:
    """Return a reader of stdin. Piped input is echoed after the prompt, so that the output is complete."""
    if sys.stdin.isatty():
        return input

    def read(text: str) -> str:
        line = sys.stdin.readline()
        if not line:
            raise EOFError
        print(f"{text}{line.rstrip()}", file=out, flush=True)
        return line

    return read


def complete_with(prompt: CommandPrompt) -> None:
    """Complete lines for this prompt with the Tab key."""
    try:
        import readline
    except ImportError:  # Python may be built without it
        return
    found: list[str] = []

    def complete(word: str, state: int) -> str | None:
        if state == 0:
            found[:] = prompt.completions(readline.get_line_buffer()[: readline.get_endidx()])
        return found[state] if state < len(found) else None

    readline.set_completer_delims(" ")
    readline.set_completer(complete)
    readline.parse_and_bind("tab: complete")
