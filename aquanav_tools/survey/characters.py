"""Survex's special characters, which *set can change, and how they cut a line into words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

DEFAULTS = {
    "blank": "\t ,",
    "comment": ";",
    "decimal": ".",
    "eol": "\n\r",
    "keyword": "*",
    "minus": "-",
    "names": "_-",
    "omit": "-",
    "plus": "+",
    "root": "\\",
    "separator": ".",
}


@dataclass(frozen=True)
class Characters:
    """Which characters do what."""

    by_item: Mapping[str, str] = field(default_factory=lambda: dict(DEFAULTS))

    def words(self, line: str) -> list[str]:
        """Return the words of a line: separated by blanks, text in double quotes kept together, comments dropped."""
        blanks, comments = self.by_item["blank"], self.by_item["comment"]
        words: list[str] = []
        place = 0
        while place < len(line) and line[place] not in comments:
            if line[place] in blanks:
                place += 1
                continue
            start = place
            if line[place] == '"' and '"' in line[place + 1 :]:
                place = line.index('"', place + 1) + 1
                words.append(line[start + 1 : place - 1])
                continue
            while place < len(line) and line[place] not in blanks and line[place] not in comments:
                place += 1
            words.append(line[start:place])
        return words

    def command(self, line: str) -> list[str] | None:
        """Return the words of a command without its keyword character; None when the line is none."""
        stripped = line.lstrip(self.by_item["blank"])
        if not stripped or stripped[0] not in self.by_item["keyword"]:
            return None
        return self.words(stripped[1:])

    def plain(self, word: str) -> str:
        """Return a reading with the usual signs and decimal point instead of those in force."""
        if word and all(char in self.by_item["omit"] for char in word):
            return "-"
        usual = [("decimal", "."), ("minus", "-"), ("plus", "+")]
        table = {ord(char): sign for item, sign in usual for char in self.by_item[item]}
        return word.translate(table)

    def with_item(self, item: str, text: str) -> Characters:
        """Return these characters with one item's replaced; xAB in the text is the character of that hex code.

        Raises:
            KeyError: there is no such item.
        """
        if item not in DEFAULTS:
            raise KeyError(item)
        decoded = re.sub(r"x([0-9A-Fa-f]{2})", lambda match: chr(int(match[1], 16)), text)
        return Characters({**self.by_item, item: decoded})
