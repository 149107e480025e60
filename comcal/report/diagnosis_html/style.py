# SPDX-License-Identifier: Apache-2.0
"""How the page looks: light and dark as the reader's system says, from phone to desktop."""

from __future__ import annotations

STYLE = """
:root { color-scheme: light dark; --paper: #ffffff; --ink: #1c2329; --soft: #5b6670;
  --line: #d9dee3; --card: #f5f7f9; --before: #c2500a; --after: #0b64a8; --band: #0b64a81f;
  --bad: #b3261e; --good: #1d7a3e; --warn: #8a5a00; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #14181c; --ink: #e6eaee; --soft: #9aa5af; --line: #333b43; --card: #1c2228;
    --before: #ff9d57; --after: #62b4f5; --band: #62b4f52e; --bad: #ff8a80; --good: #6fd58f;
    --warn: #f0bd5c; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 72rem; padding: 1rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.35rem; line-height: 1.3; margin: .5rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; }
h3 { font-size: 1rem; margin: 0 0 .25rem; overflow-wrap: anywhere; }
p, ul, dl { margin: .4rem 0; overflow-wrap: anywhere; }
.soft, figcaption, footer { color: var(--soft); }
.verdict { border-left: .4rem solid var(--soft); padding: .4rem .8rem; background: var(--card); }
.verdict.explained, .verdict.nothing_wrong { border-color: var(--good); }
.verdict.ambiguous { border-color: var(--warn); }
.verdict.unexplained { border-color: var(--bad); }
.verdict strong { overflow-wrap: anywhere; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: .4rem;
  padding: .8rem 1rem; margin: .8rem 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .2rem 1rem .2rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; font-weight: normal; white-space: nowrap; }
thead th { color: var(--soft); }
tbody th { font-weight: 600; }
td.words { white-space: normal; min-width: 12rem; }
@media (max-width: 30rem) { th, td { padding-right: .6rem; } table { font-size: .85rem; }
  ul { padding-left: 1.2rem; } }
.grid { display: grid; gap: .8rem; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); }
figure { margin: 0; }
figcaption { font-size: .85rem; overflow-wrap: anywhere; }
summary { cursor: pointer; padding: .4rem 0; }
svg { display: block; width: 100%; height: auto; font: 10px system-ui, sans-serif; }
svg text { fill: var(--soft); }
svg text.label { fill: var(--ink); font-size: 11px; }
svg text.named { fill: var(--ink); font-size: 11px; font-weight: 600; }
svg .rule { stroke: var(--line); stroke-width: .5; }
svg .zero { stroke: var(--soft); stroke-width: .8; }
svg .band { fill: var(--band); }
svg circle.before { fill: none; stroke: var(--before); stroke-width: 1.2; }
svg circle.after, svg circle.raw { fill: var(--after); }
svg circle.refused { fill: var(--bad); }
svg rect.above { fill: var(--after); }
svg rect.below { fill: var(--soft); opacity: .6; }
svg .threshold { stroke: var(--bad); stroke-dasharray: 4 3; }
svg rect.frame { fill: none; stroke: var(--line); stroke-width: .5; }
svg rect.share { fill: var(--after); }
svg text.percent { fill: var(--ink); }
svg text.strong { fill: var(--paper); }
.key { padding: 0 .3rem; border-radius: .2rem; }
.key.before { color: var(--before); font-weight: 600; }
.key.after { color: var(--after); font-weight: 600; }
.key.band { background: var(--band); }
"""
