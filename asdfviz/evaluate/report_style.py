"""Colours and style sheet of the report page: one file, light and dark, no network. Pure."""

from __future__ import annotations

import html

from asdfviz.render.state_ramp import state_color

RUN_LIGHT = ("#0b6cb3", "#c2410c", "#7c3aed", "#15803d", "#a16207", "#be185d", "#0f766e", "#57534e")
RUN_DARK = ("#5ec4ff", "#ff9a76", "#ba93ff", "#81d484", "#ffc14f", "#f078be", "#78ded2", "#c4b496")
DASHES = ("", "7 3", "2 3", "9 3 2 3", "4 2", "1 2", "12 4", "6 2 2 2")
"""Curves differ by dash too, never by colour alone."""
PART_COLORS = (
    *("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#d9c400", "#d55e00", "#0072b2", "#8a8a8a"),
    *("#88ccee", "#999933", "#aa4499", "#44aa99"),
)


def escape(value: object) -> str:
    """Text as HTML and SVG show it, in content and in attributes."""
    return html.escape(str(value), quote=True)


def part_color(place: int) -> str:
    """Colour of the part at a place of the assembly."""
    return PART_COLORS[place % len(PART_COLORS)]


def on_state(index: int, count: int) -> tuple[str, str]:
    """Fill of correct state `index` of `count`, and the text colour that reads on it."""
    red, green, blue = state_color(index, count)
    ink = "#0d0f12" if 0.3 * red + 0.59 * green + 0.11 * blue > 120 else "#fff"
    return f"rgb({red} {green} {blue})", ink


def _run_variables(colors: tuple[str, ...]) -> str:
    return "".join(f"--run{i}:{color};" for i, color in enumerate(colors))


STYLE = f"""
:root{{color-scheme:light dark;--bg:#f6f6f3;--card:#fff;--ink:#1b1f24;--soft:#5b636d;--line:#dfe1dd;
--grid:#e9eae6;--accent:#0b6cb3;--good:#0f7a4d;--bad:#b3261e;--none:#d4d7d2;{_run_variables(RUN_LIGHT)}}}
@media (prefers-color-scheme:dark){{:root{{--bg:#0e1116;--card:#161b22;--ink:#e6e9ed;--soft:#9aa4b0;
--line:#2a313b;--grid:#222933;--accent:#5ec4ff;--good:#6fd8a4;--bad:#ff8f85;--none:#333b46;
{_run_variables(RUN_DARK)}}}}}
*{{box-sizing:border-box}}
body{{margin:0;background:var(--bg);color:var(--ink);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;
font-variant-numeric:tabular-nums}}
main{{max-width:1180px;margin:0 auto;padding:36px 24px 72px}}
h1{{font-size:28px;line-height:1.2;margin:0 0 4px;letter-spacing:-.01em}}
h2{{font-size:19px;margin:44px 0 4px;letter-spacing:-.005em}}
h3{{font-size:15px;margin:0 0 10px;font-weight:600}}
h3.next{{margin:22px 0 6px}}
p{{margin:4px 0 12px;color:var(--soft);max-width:78ch}}
code{{font:13px ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}}
nav{{margin:16px 0 0;display:flex;flex-wrap:wrap;gap:4px 18px}}
a{{color:var(--accent);text-decoration:none}}a:hover{{text-decoration:underline}}
.card{{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:18px 20px;
margin:12px 0}}
.scroll{{overflow-x:auto}}
.two{{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,430px),1fr));gap:12px}}
.two>.card{{margin:0}}
table{{border-collapse:collapse;width:100%;font-size:13.5px}}
th{{font-weight:500;color:var(--soft);text-align:right;padding:5px 7px;vertical-align:bottom;
border-bottom:1px solid var(--line);line-height:1.25}}
th small{{display:block;font-size:11.5px;opacity:.85;white-space:nowrap}}
td{{text-align:right;padding:6px 7px;border-bottom:1px solid var(--grid);white-space:nowrap}}
tbody tr:last-child td{{border-bottom:0}}
th.t,td.t{{text-align:left}}
td.t{{max-width:230px;overflow:hidden;text-overflow:ellipsis}}
sub{{font-size:.75em;line-height:0}}
td.best{{font-weight:700;color:var(--good)}}td.part{{color:var(--bad)}}
tr.mean td{{border-top:1px solid var(--line);font-weight:600}}
.chip{{display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:7px;
vertical-align:-1px}}
.legend{{display:flex;flex-wrap:wrap;gap:4px 16px;font-size:13px;color:var(--soft);margin:8px 0 0}}
.legend span{{overflow-wrap:anywhere}}
.legend svg{{width:30px;height:10px;margin-right:6px;vertical-align:0}}
svg.chart{{width:100%;height:auto;display:block}}
.chart text{{fill:var(--soft);font-size:12px}}.chart .grid{{stroke:var(--grid)}}
.chart .axis{{stroke:var(--line)}}.chart .mark{{stroke:var(--soft);stroke-dasharray:2 4;opacity:.7}}
.chart .curve{{fill:none;stroke-width:2.2;stroke-linejoin:round}}
.strip{{display:grid;grid-template-columns:150px 1fr;gap:0 12px;align-items:center;margin:0 0 7px}}
.strip>b{{font-weight:500;font-size:13px;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}}
.bar{{display:flex;height:26px;border-radius:5px;overflow:hidden;background:var(--none)}}
.bar i{{font-style:normal;font-size:11.5px;line-height:26px;padding:0;overflow:hidden;
white-space:nowrap;text-align:center;min-width:0;flex-basis:0}}
.bar i.none{{background:var(--none)}}
.bar i.error{{background:repeating-linear-gradient(45deg,#d64545 0 5px,#8f2323 5px 10px);color:#fff}}
.missed{{fill:#d64545;fill-opacity:.35;stroke:none}}
.chip.error{{background:repeating-linear-gradient(45deg,#d64545 0 3px,#8f2323 3px 6px)}}
.chip.none{{background:var(--none)}}
.off{{grid-column:2;height:24px;margin:1px 0 4px}}
.off svg{{width:100%;height:24px;display:block}}
.ticks{{grid-column:2;position:relative;height:18px;font-size:11.5px;color:var(--soft)}}
.ticks span{{position:absolute;transform:translateX(-50%)}}
.ticks span:first-child{{transform:none}}.ticks span:last-child{{transform:translateX(-100%)}}
table.matrix{{width:auto}}
.matrix td{{text-align:center;min-width:40px;padding:5px 3px;border:1px solid var(--card)}}
.matrix td small{{display:block;font-size:10.5px;opacity:.75;line-height:1.1}}
.matrix th{{border:0;text-align:center;vertical-align:middle}}.matrix th.t{{text-align:left;font-size:13px;
max-width:140px;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}}
.matrix th{{padding:4px 5px;font-size:12.5px}}
.shots{{display:grid;grid-template-columns:repeat(auto-fill,minmax(250px,1fr));gap:14px}}
figure{{margin:0}}figure img{{width:100%;height:auto;display:block;border-radius:8px;background:#000}}
figcaption{{font-size:12.5px;color:var(--soft);margin-top:5px;line-height:1.35}}
.chart+.legend{{padding-left:2px}}
figcaption b{{color:var(--ink);font-weight:600;overflow-wrap:anywhere}}
details{{margin-top:10px}}summary{{cursor:pointer;color:var(--soft);font-size:13.5px}}
pre{{font:12px/1.45 ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;overflow-x:auto;
background:var(--bg);border-radius:8px;padding:12px}}
ul.warn{{margin:8px 0 0;padding-left:20px;color:var(--bad);font-size:13.5px}}
footer{{margin-top:48px;color:var(--soft);font-size:12.5px}}
@media (max-width:640px){{main{{padding:24px 14px 48px}}.card{{padding:14px}}
.strip{{grid-template-columns:76px 1fr}}.bar i{{font-size:0}}}}
@media print{{body{{background:#fff}}.card{{break-inside:avoid}}nav{{display:none}}}}
"""
