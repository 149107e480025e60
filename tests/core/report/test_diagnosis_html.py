# SPDX-License-Identifier: Apache-2.0
"""The page of a diagnosis: well-formed, self-contained, of no numbers but those it was given."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

from comcal.report.diagnosis_html.ladder import rung_chart
from comcal.report.diagnosis_html.markup import Markup, element
from comcal.report.diagnosis_html.page import PageSubject, comparison_page, diagnosis_page
from comcal.report.diagnosis_html.raw import RawChannel
from comcal.report.diagnosis_html.svg import framed, round_numbers
from comcal.report.diagnosis_html.traces import trace_chart

SVG = "{http://www.w3.org/2000/svg}"
VERDICTS = ("nothing_wrong", "explained", "ambiguous", "unexplained")


def subject(diagnosis, **more) -> PageSubject:
    poses = tuple(range(1, 25))
    raw = (RawChannel("l_foot fz", "N", poses, np.linspace(300.0, 310.0, 24)),)
    return PageSubject("monday <& tuesday>", diagnosis, raw, **more)


def tree_of(page: str):
    return etree.fromstring(page.removeprefix("<!DOCTYPE html>\n"))


def text_of(page: str) -> str:
    body = tree_of(page).find("body")
    return " ".join(" ".join(body.itertext()).split())


@pytest.mark.parametrize("verdict", VERDICTS)
def test_page_is_well_formed_and_fetches_nothing(verdict, diagnoses) -> None:
    page = diagnosis_page(subject(diagnoses[verdict]))
    tags = {str(node.tag).removeprefix(SVG) for node in tree_of(page).iter()}
    assert not tags & {"script", "link", "img", "iframe", "object", "use", "image"}
    outside = set(re.findall(r"https?://[^\"\s]+", page)) - {"http://www.w3.org/2000/svg"}
    assert not outside
    assert "url(" not in page
    assert "@import" not in page


@pytest.mark.parametrize("verdict", VERDICTS)
def test_page_opens_with_the_sentence_and_the_verdict(verdict, diagnoses) -> None:
    diagnosis = diagnoses[verdict]
    text = text_of(diagnosis_page(subject(diagnosis)))
    verdict_words = verdict.replace("_", " ").upper()
    assert text.startswith(f"monday <& tuesday> {diagnosis.sentence} {verdict_words}")


def test_what_was_measured_cannot_become_markup(diagnoses) -> None:
    page = diagnosis_page(subject(diagnoses["unexplained"]))
    assert "&lt;its&gt; amplifier" in page
    evil = replace(diagnoses["explained"], sentence='<script>alert("x")</script>')
    assert "<script" not in diagnosis_page(subject(evil))
    assert element("p", "a<b", class_='"x"') == '<p class="&quot;x&quot;">a&lt;b</p>'
    assert element("p", Markup("<b>c</b>")) == "<p><b>c</b></p>"


def test_every_drawing_has_a_title_that_is_read_out(diagnoses) -> None:
    drawings = list(tree_of(diagnosis_page(subject(diagnoses["explained"]))).iter(f"{SVG}svg"))
    assert len(drawings) == 4 + 1 + 2 + 1  # residuals, readings, steps of the ladder, matrix
    for drawing in drawings:
        assert drawing.get("role") == "img"
        assert drawing.get("aria-label")
        assert drawing.find(f"{SVG}title").text


def test_page_has_a_dark_side_and_a_viewport(diagnoses) -> None:
    page = diagnosis_page(subject(diagnoses["explained"]))
    assert "prefers-color-scheme: dark" in page
    assert 'name="viewport" content="width=device-width' in page
    light, dark = page.split("prefers-color-scheme: dark")
    named = set(re.findall(r"var\((--\w+)\)", page))
    for colour in named:
        assert f"{colour}:" in light
        assert f"{colour}:" in dark


def test_numbers_are_those_of_the_diagnosis(diagnoses) -> None:
    text = text_of(diagnosis_page(subject(diagnoses["explained"])))
    for words in ("101.3 mm", "93.3 to 109.3", "1:400", "3.42 -> 1.02", "33 to 48 %", "812.4"):
        assert words in text
    other = replace(
        diagnoses["explained"],
        misfit=replace(diagnoses["explained"].misfit, held_out_before=7.77),
    )
    assert "7.77 -> 1.02" in text_of(diagnosis_page(subject(other)))
    assert "7.77" not in text


def test_a_chart_shows_every_reading_that_is_there(diagnoses) -> None:
    trace = diagnoses["explained"].traces[1]
    chart = etree.fromstring(trace_chart(trace))
    circles = [node.get("class") for node in chart.iter(f"{SVG}circle")]
    assert circles.count("after") == len(trace.poses)
    assert circles.count("before") == np.isfinite(trace.before).sum() == len(trace.poses) - 1
    assert f"pose 1: {trace.before[0]:.3g} N m before" in "".join(chart.itertext())


def test_residuals_lie_higher_the_larger_they_are(diagnoses) -> None:
    trace = diagnoses["explained"].traces[0]
    chart = etree.fromstring(trace_chart(trace))
    y = [float(c.get("cy")) for c in chart.iter(f"{SVG}circle") if c.get("class") == "before"]
    assert np.array_equal(np.argsort(y), np.argsort(-trace.before))


def test_bars_of_the_ladder_are_as_long_as_their_log_odds(diagnoses) -> None:
    rung = diagnoses["explained"].ladder[0]
    chart = etree.fromstring(rung_chart(rung, 0))
    widths = [float(bar.get("width")) for bar in chart.iter(f"{SVG}rect")]
    assert widths[1] / widths[0] == pytest.approx(806.0 / 812.4, rel=1e-3)
    line = next(node for node in chart.iter(f"{SVG}line") if node.get("class") == "threshold")
    assert float(line.get("x1")) / widths[0] == pytest.approx(8.1 / 812.4, abs=1e-3)
    below = etree.fromstring(rung_chart(diagnoses["explained"].ladder[1], 1))
    assert {bar.get("class") for bar in below.iter(f"{SVG}rect")} == {"below"}


def test_matrix_is_darker_where_more_of_the_effect_is(diagnoses) -> None:
    tree = tree_of(diagnosis_page(subject(diagnoses["explained"])))
    cells = {
        node.getparent().find(f"{SVG}title").text: float(node.get("fill-opacity"))
        for node in tree.iter(f"{SVG}rect")
        if node.get("class") == "share"
    }
    assert cells["payload@torso, equilibrium: 81 %"] == pytest.approx(0.9)
    assert cells["link_mass@torso, torque: 50 %"] == pytest.approx(0.71)
    assert not [name for name in cells if "closure" in name], "no effect shows there"


def test_poses_with_refused_readings_are_marked_in_the_raw_channels(diagnoses) -> None:
    page = diagnosis_page(subject(diagnoses["unexplained"]))
    assert page.count('class="refused"') == 3
    assert "pose 9: 303.5 N, under reserve" in page


def test_several_sessions_are_compared_in_a_table(diagnoses) -> None:
    subjects = [subject(d, facts=(("mass", "64.1 kg"),)) for d in diagnoses.values()]
    page = comparison_page(subjects)
    rows = tree_of(page).find("body/main/div/table/tbody").findall("tr")
    assert len(rows) == 4
    assert "explained" in "".join(rows[0].itertext())
    assert "3.42 -> 1.02" in "".join(rows[0].itertext())
    assert "mass 64.1 kg" in "".join(rows[0].itertext())
    assert len(tree_of(page).findall("body/main/details")) == 4


@pytest.mark.parametrize("values", [[], [np.nan], [0.0], [3.0, 3.0], [-1e-9, 1e-9], [0.0, 1e7]])
def test_axes_hold_whatever_there_is(values) -> None:
    frame = framed(values, len(values), zero=False)
    assert frame.low < frame.high
    assert all(frame.low < v < frame.high for v in values if np.isfinite(v))
    assert 2 <= len(round_numbers(frame.low, frame.high)) <= 8
