"""The look of a report's page: light and dark, wide and narrow, on screen and on paper.

Only `document` makes a whole page. The page's content security policy keeps the browser from
loading anything, so the page is the same wherever it is opened.
"""

from __future__ import annotations

from string import Template

from surefoot.study.report.markup import Markup, escaped

DARK = """
  --paper: #14181d; --ink: #e6e8ea; --soft: #a7b0ba; --grid: #333b45; --line: #3a434e;
  --panel: #1b2027; --link: #7cc4f5; --good: #4fd0a5; --bad: #ff9b66;
  --technique-0: #56b4e9; --technique-1: #ff8c4b; --technique-2: #2fc493; --technique-3: #e3a5cb;
  --technique-4: #f2b632; --technique-5: #9ad7ff; --technique-6: #a9a9a9; --technique-7: #f0e442;
  --technique-8: #b794e0;
"""
LIGHT = """
  --paper: #ffffff; --ink: #1b1f24; --soft: #59636e; --grid: #e3e3e3; --line: #d0d7de;
  --panel: #f6f8fa; --link: #0058a3; --good: #00704f; --bad: #a94400;
  --technique-0: #0072b2; --technique-1: #d55e00; --technique-2: #009e73; --technique-3: #cc79a7;
  --technique-4: #e69f00; --technique-5: #56b4e9; --technique-6: #666666; --technique-7: #f0e442;
  --technique-8: #7b4fa3;
"""
STYLE = Template("""
:root { color-scheme: light dark; $light }
@media (prefers-color-scheme: dark) { :root { $dark } }
@media print { :root { color-scheme: light; $light } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem clamp(0.8rem, 4vw, 2.5rem) 4rem; max-width: 74rem;
  background: var(--paper); color: var(--ink); line-height: 1.5;
  font: 1rem/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0.5rem 0; text-wrap: balance; }
h2 { font-size: 1.3rem; margin: 2.6rem 0 0.6rem; border-top: 1px solid var(--line);
  padding-top: 1.2rem; }
h3 { font-size: 1.05rem; margin: 2rem 0 0.4rem; }
p { max-width: 46rem; margin: 0.5rem 0; }
a { color: var(--link); }
nav ul { display: flex; flex-wrap: wrap; gap: 0.3rem 1.1rem; padding: 0; list-style: none; }
.soft, caption, figcaption, dt { color: var(--soft); }
.notice { border-left: 4px solid var(--bad); padding: 0.5rem 0.9rem; background: var(--panel); }
figure { margin: 1rem 0; }
figcaption { max-width: 46rem; font-size: 0.92rem; }
.scroll { overflow-x: auto; margin: 0.6rem 0 1rem; }
svg.figure { display: block; width: 100%; min-width: 34rem; max-height: none; height: auto; }
svg.figure text { font-family: system-ui, "Segoe UI", Roboto, Arial, sans-serif; }
table { border-collapse: collapse; font-size: 0.9rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: 0.3rem 0; font-size: 0.88rem; }
th, td { padding: 0.28rem 0.7rem 0.28rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }
thead th { border-bottom: 2px solid var(--line); }
tbody th { font-weight: 500; }
code { font: 0.86em ui-monospace, "SF Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
td code { overflow-wrap: normal; }
pre { background: var(--panel); padding: 0.7rem 0.9rem; overflow-x: auto; }
details { margin: 0.5rem 0; }
summary { cursor: pointer; color: var(--link); padding: 0.2rem 0; }
dl { display: grid; grid-template-columns: minmax(9rem, max-content) 1fr; gap: 0.25rem 1.2rem;
  margin: 0.8rem 0; }
dd { margin: 0; overflow-wrap: anywhere; }
.verdict { white-space: nowrap; font-weight: 600; }
.holds { color: var(--good); }
.fails { color: var(--bad); }
.films { display: flex; flex-wrap: wrap; gap: 1rem; }
.films figure { width: min(100%, 20rem); }
.films video { width: 100%; height: auto; border: 1px solid var(--line); }
@media (max-width: 40rem) { dl { grid-template-columns: 1fr; gap: 0; } dd { margin: 0 0 0.5rem; } }
""")
PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; style-src 'unsafe-inline'; img-src data:; media-src data:">
<title>$title</title>
<style>$style</style>
</head>
<body>
<main>
$body
</main>
</body>
</html>
""")


def document(title: str, body: Markup) -> bytes:
    """A whole page.

    Args:
        title: Title of the page, as plain text.
        body: What it shows.
    """
    style = STYLE.substitute(light=LIGHT, dark=DARK)
    return PAGE.substitute(title=escaped(title), style=style, body=body).encode()
