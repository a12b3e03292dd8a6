"""The card with a method's options, over the picture. Its fields live in the page until Run is pressed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from asdfviz.app.markup import act, button, text
from asdfviz.app.options import Group, Option, option_groups
from asdfviz.datatypes import Assembly
from asdfviz.methods.network import NetworkConfig, weights_path
from asdfviz.methods.spec import MethodSpec

_BOOLEANS = ("True", "False")


def card(name: str, spec: MethodSpec, assembly: Assembly, chosen: Mapping[str, str]) -> str:
    """The form of a method as HTML.

    Args:
        name: how the method is called here.
        spec: the method.
        assembly: says where its weights lie unless others are named.
        chosen: what was changed before, by option.
    """
    weights = weights_path(NetworkConfig(), assembly)
    groups = option_groups(spec.config)
    body = "".join(_group(group, i == 0, chosen, weights) for i, group in enumerate(groups))
    if not groups:
        body = "<p>This method has no options.</p>"
    run = button(
        "Run", act("RunMethod", method=name), classes="ax-primary ax-submit", testid="options-run"
    )
    close = button("Close", act("Cancel"), key="Esc", testid="options-close")
    reset = '<span class="ax-btn ax-reset" role="button" tabindex="0">Defaults</span>'
    return (
        f'<div class="ax-card ax-wide ax-form" role="dialog" aria-label="Options of {text(spec.name)}" '
        f'data-testid="options" data-form="{text(name)}"><h2>Run {text(spec.name)}</h2>'
        f'<div class="ax-scroll">{body}</div>'
        f'<div class="ax-end">{reset}<span class="ax-fill"></span>{close}{run}</div></div>'
    )


def _group(group: Group, is_open: bool, chosen: Mapping[str, str], weights: Path) -> str:
    changed = sum(option.name in chosen for option in group.options)
    rows = "".join(_row(option, chosen, weights) for option in group.options)
    title = group.name.replace("_", " ").replace(".", ": ") or "general"
    note = f"<em>{changed} changed</em>" if changed else ""
    return (
        f"<details{' open' if is_open or changed else ''}><summary>{text(title)}"
        f"<small>{text(group.hint)}</small>{note}</summary>{rows}</details>"
    )


def _row(option: Option, chosen: Mapping[str, str], weights: Path) -> str:
    value = chosen.get(option.name, option.default)
    field = f'data-option="{text(option.name)}" data-default="{text(option.default)}"'
    if option.kind in ("choice", "switch"):
        choices = option.choices or _BOOLEANS
        names = {"True": "on", "False": "off"} if option.kind == "switch" else {"": "default"}
        items = "".join(
            f'<option value="{text(c)}"{" selected" if c == value else ""}>{text(names.get(c, c))}</option>'
            for c in choices
        )
        control = f"<select {field}>{items}</select>"
    else:
        hint = str(weights) if option.label == "weights" and not option.default else ""
        mode = ' inputmode="decimal"' if option.kind in ("whole", "number") else ""
        control = (
            f'<input type="text" spellcheck="false" autocomplete="off" {field}{mode} '
            f'value="{text(value)}" placeholder="{text(hint)}">'
        )
    wide = " ax-long" if option.kind == "text" else ""
    return (
        f'<label class="ax-option{wide}"><b>{text(option.label)}</b>{control}'
        f"<small>{text(option.hint)}</small></label>"
    )
