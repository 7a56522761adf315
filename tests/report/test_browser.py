"""Pages as a browser shows them, on a phone and on a desk."""

import synthetic_diagnosis as synthetic
from browser import PHONE, assert_readable, looked_at, needs_chromium

from twin.report.html import render


@needs_chromium
def test_reports_are_drawn_and_fit_into_the_window(tmp_path):
    made = {
        "explained": synthetic.diagnosis(duration=0.5),
        "outside": synthetic.outside(duration=0.5),
    }
    assert_readable({name: render(diagnosis) for name, diagnosis in made.items()}, tmp_path, figures=6)


@needs_chromium
def test_what_a_reader_would_miss_is_found(tmp_path):
    page = render(synthetic.nothing_missing(duration=0.5))
    broken = page.replace("</main>", '<p style="width:900px">wide</p><script>nothing();</script></main>')
    broken = broken.replace('"type":"scatter"', '"visible":false,"type":"scatter"')
    told = looked_at({"broken": broken}, tmp_path)["broken", PHONE]
    assert len(told["empty"]) == told["figures"]
    assert any("nothing is not defined" in error for error in told["errors"])
    assert any(place.startswith("P.") for place in told["wider"])
