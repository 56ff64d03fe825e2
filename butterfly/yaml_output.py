"""Write plain values as YAML that every reader reads the same."""

from __future__ import annotations

import io
import re
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import SafeRepresenter

_ONE_LINE = 1_000_000  # characters: nothing is wrapped
# What needs no quotes, unless it reads as a value.
_WORDS = re.compile(r"[^\W\d]([\w ./-]*[\w./-])?")


def yaml_text(content: dict[str, Any], *, flow: bool = False) -> str:
    """Return plain values as YAML, in the order of their keys; mappings in braces if ``flow``."""
    writer = YAML(typ="safe", pure=True)
    writer.Representer = _PlainWriter
    writer.default_flow_style = flow
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # typed as None
    writer.width = _ONE_LINE
    text = io.StringIO()
    writer.dump(content, text)
    return text.getvalue()


class _PlainWriter(SafeRepresenter):
    """Writes numbers and texts so that every reader sees the same.

    Readers of YAML 1.1 see numbers in 1.0e-05, not in 1e-05. Texts other than words are quoted:
    ruamel.yaml 0.19 would write the text ``: 1`` bare in braces.
    """

    def represent_str(self, data: str) -> ScalarNode:
        style = None if _WORDS.fullmatch(data) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)

    def represent_float(self, data: float) -> ScalarNode:
        node = super().represent_float(data)
        if "." not in node.value:
            node.value = node.value.replace("e", ".0e")
        return node


_PlainWriter.add_representer(str, _PlainWriter.represent_str)
_PlainWriter.add_representer(float, _PlainWriter.represent_float)
