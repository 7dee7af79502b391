"""The page as HTML text: skeleton, style and small building blocks. Everything that enters is escaped here."""

import html
import json
import re
from collections.abc import Sequence
from string import Template
from typing import NamedTuple

STYLE = """
:root{--ink:#1f2430;--quiet:#5b616b;--line:#e3e6ea;--accent:#0072b2;--warn:#b34700;--paper:#fff;--wash:#f6f7f9}
*{box-sizing:border-box}
html{scroll-behavior:smooth;scroll-padding-top:1rem}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.6 system-ui,"Segoe UI",Roboto,"Helvetica Neue",
 Arial,sans-serif;-webkit-font-smoothing:antialiased}
.page{display:grid;grid-template-columns:13rem minmax(0,62rem);gap:3rem;justify-content:center;padding:0 1.5rem}
nav{position:sticky;top:0;align-self:start;padding:3.6rem 0 1rem;font-size:.875rem}
nav ol{list-style:none;margin:0;padding:0;border-left:1px solid var(--line)}
nav a{display:block;padding:.22rem 0 .22rem .9rem;color:var(--quiet);text-decoration:none;margin-left:-1px;
 border-left:2px solid transparent}
nav a:hover,nav a:focus-visible{color:var(--accent);border-left-color:var(--accent)}
nav b{display:block;padding:0 0 .6rem;letter-spacing:.02em}
main{padding:3rem 0 5rem;min-width:0}
h1{font-size:2.05rem;line-height:1.2;margin:0 0 .8rem;letter-spacing:-.015em;text-wrap:balance}
h2{font-size:1.3rem;line-height:1.3;margin:3.2rem 0 .6rem;letter-spacing:-.01em}
h3{font-size:1rem;margin:1.8rem 0 .3rem}
p,li{max-width:46rem}
p{margin:.5rem 0}
.lead{font-size:1.1rem;color:#343a46}
.note{border-left:3px solid var(--warn);background:#fff7f0;padding:.7rem 1rem;margin:1.2rem 0;max-width:50rem}
.note ul{margin:.2rem 0;padding-left:1.1rem}
.absent{border:1px dashed #c5cad2;border-radius:6px;color:var(--quiet);padding:.8rem 1rem;max-width:50rem}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(9.5rem,1fr));gap:.8rem;margin:1.4rem 0}
.tile{background:var(--wash);border-radius:8px;padding:.7rem .9rem}
.tile b{display:block;font-size:1.35rem;line-height:1.25;font-variant-numeric:tabular-nums}
.tile span{font-size:.82rem;color:var(--quiet)}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums;margin:.8rem 0;min-width:30rem}
th,td{padding:.38rem .9rem .38rem 0;text-align:right;border-bottom:1px solid var(--line);vertical-align:top}
th{font-weight:600;color:var(--quiet);font-size:.82rem;border-bottom:1px solid #9aa0a8}
th:first-child,td:first-child,td.text,th.text{text-align:left}
td.bad{color:var(--warn);font-weight:600}
figure{margin:1.2rem 0}
figure svg{display:block;width:100%;height:auto;min-width:34rem}
figure svg *{stroke-linejoin:round}
figcaption{font-size:.875rem;color:var(--quiet);max-width:46rem;margin-top:.3rem}
.tabs{display:flex;flex-wrap:wrap;gap:.4rem;margin:.9rem 0 .5rem}
.tabs button{font:inherit;font-size:.875rem;padding:.25rem .8rem;border:1px solid #c5cad2;border-radius:99px;
 background:#fff;color:var(--ink);cursor:pointer}
.tabs button[aria-selected=true]{background:var(--ink);border-color:var(--ink);color:#fff}
iframe{display:block;width:100%;height:30rem;border:1px solid var(--line);border-radius:8px;background:#fff}
.key{display:flex;flex-wrap:wrap;gap:.2rem 1.2rem;font-size:.85rem;color:var(--quiet);margin:.5rem 0;padding:0;
 list-style:none}
.key i{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.4em;vertical-align:-.05em}
dl{display:grid;grid-template-columns:max-content minmax(0,1fr);gap:.2rem 1.2rem;font-size:.92rem}
dt{color:var(--quiet)}dd{margin:0;overflow-wrap:anywhere}
details{margin:.6rem 0}summary{cursor:pointer;color:var(--accent)}
pre{background:var(--wash);border-radius:6px;padding:.8rem 1rem;overflow-x:auto;font-size:.8rem;line-height:1.45}
footer{margin-top:4rem;border-top:1px solid var(--line);padding-top:.8rem;font-size:.82rem;color:var(--quiet)}
@media(max-width:60rem){.page{display:block;padding:0 1.1rem}nav{position:static;padding:1.4rem 0 0}
 main{padding-top:1.2rem}iframe{height:22rem}}
@media print{nav,.tabs,iframe{display:none}h2{break-after:avoid}figure{break-inside:avoid}}
"""

PLAYER = """
(function(){
  const start=$start,end=$end,scenes=$scenes;
  const frame=document.getElementById("scene"),tabs=[...document.querySelectorAll("#scene-tabs button")];
  function show(k){
    tabs.forEach((tab,i)=>tab.setAttribute("aria-selected",String(i===k)));
    frame.srcdoc=start+scenes[k]+end;
  }
  tabs.forEach((tab,k)=>tab.addEventListener("click",()=>show(k)));
  document.getElementById("scene-dark").hidden=!!document.createElement("canvas").getContext("webgl2");
  show(0);
})();
"""

SKELETON = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="icjax">
<link rel="icon" href="data:,">
<title>$title</title>
<style>$style</style>
</head>
<body>
<div class="page">
<nav aria-label="Contents"><b>$short</b><ol>
$contents
</ol></nav>
<main>
<header>
<h1>$title</h1>
$header
</header>
$sections
<footer>$footer</footer>
</main>
</div>
$script
</body>
</html>
""")


class Section(NamedTuple):
    """One part of the page: anchor, heading and finished HTML."""

    anchor: str
    heading: str
    body: str


def page(title: str, short: str, header: str, sections: Sequence[Section], footer: str, script: str) -> str:
    """The whole document. `header`, `footer`, `script` and the bodies of `sections` are HTML, the rest is text."""
    contents = "\n".join(f'<li><a href="#{part.anchor}">{text(part.heading)}</a></li>' for part in sections)
    bodies = "\n".join(
        f'<section id="{part.anchor}">\n<h2>{text(part.heading)}</h2>\n{part.body}\n</section>' for part in sections
    )
    return SKELETON.substitute(
        title=text(title),
        short=text(short),
        style=STYLE,
        header=header,
        contents=contents,
        sections=bodies,
        footer=footer,
        script=script,
    )


def text(value: object) -> str:
    """Any value as HTML text, escaped."""
    return html.escape(str(value), quote=True)


def paragraph(words: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{text(words)}</p>"


def absent(words: str) -> str:
    """A box that says what is not there and why."""
    return f'<p class="absent">{text(words)}</p>'


def note(points: Sequence[str]) -> str:
    """A box of warnings."""
    return '<aside class="note"><ul>' + "".join(f"<li>{text(point)}</li>" for point in points) + "</ul></aside>"


def tiles(values: Sequence[tuple[str, str]]) -> str:
    """Key figures: (value, what it is)."""
    inner = "".join(f'<div class="tile"><b>{text(value)}</b><span>{text(name)}</span></div>' for value, name in values)
    return f'<div class="tiles">{inner}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: Sequence[int] = (0,)) -> str:
    """A table of text; the columns in `words` are aligned left."""

    def cell(tag: str, column: int, value: str) -> str:
        kind = ' class="text"' if column in words else ""
        return f"<{tag}{kind}>{text(value)}</{tag}>"

    top = "".join(cell("th", column, value) for column, value in enumerate(head))
    body = "".join(
        "<tr>" + "".join(cell("td", column, value) for column, value in enumerate(row)) + "</tr>" for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def figure(svg: str, caption: str) -> str:
    """An inlined drawing with its caption."""
    return f'<figure><div class="scroll">{svg}</div><figcaption>{text(caption)}</figcaption></figure>'


def pairs(values: Sequence[tuple[str, str]]) -> str:
    """A list of names and values."""
    return "<dl>" + "".join(f"<dt>{text(name)}</dt><dd>{text(value)}</dd>" for name, value in values) + "</dl>"


def folded(summary: str, content: str) -> str:
    """Preformatted text behind a line to click."""
    return f"<details><summary>{text(summary)}</summary><pre>{text(content)}</pre></details>"


def player(names: Sequence[str], pages: Sequence[str]) -> tuple[str, str]:
    """Several 3-D pages behind tabs in one frame, the viewer that they share stored once.

    **Returns**: the HTML of the frame and the script that fills it (to go at the end of the body).

    **Errors**: `ValueError` where the pages are not viser exports.
    """
    parts = [re.split(r'(__VISER_EMBED_DATA__=")([^"]*)', item, maxsplit=1) for item in pages]
    if any(len(part) != 4 for part in parts):
        raise ValueError("a 3-D page holds no viser recording: __VISER_EMBED_DATA__ is missing")
    if len({(part[0], part[3]) for part in parts}) != 1:
        raise ValueError("the 3-D pages were made by different viewers")
    buttons = "".join(
        f'<button type="button" role="tab" aria-selected="{str(index == 0).lower()}">{text(name)}</button>'
        for index, name in enumerate(names)
    )
    frame = f'<div class="tabs" id="scene-tabs" role="tablist">{buttons}</div>'
    frame += '<iframe id="scene" title="3-D view with time bar"></iframe><div id="scene-dark" hidden>'
    frame += (
        absent("This browser draws nothing in 3-D (WebGL is off or missing): the frame above stays empty.") + "</div>"
    )
    script = Template(PLAYER).substitute(
        start=script_text(parts[0][0] + parts[0][1]),
        end=script_text(parts[0][3]),
        scenes=script_text([part[2] for part in parts]),
    )
    return frame, f"<script>{script}</script>"


def script_text(value: object) -> str:
    """A value as JavaScript source that cannot end the script element."""
    return json.dumps(value).replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
