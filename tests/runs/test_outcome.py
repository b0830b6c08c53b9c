"""What the screen says of a finished run."""

import pytest

from driver.runs import outcome


@pytest.mark.parametrize("asked, made, bodies, said", [
    ("13", 12, 3, "12 subdomains (13 requested;"), ("12", 12, 3, "12 subdomains"),
    ("auto", 12, 3, "12 subdomains"), ("3x4", 12, 1, "12 subdomains"),
    (None, 1, 1, "1 subdomain")])
def test_other_numbers_of_subdomains_than_asked_for_are_said(asked, made, bodies, said):
    summary = {"sizes": {"subdomains": made}, "effects": {"bodies": bodies},
               "parameters": {"subdomains": asked} if asked else {}}
    words = outcome.subdomains(summary)
    assert words.startswith(said) and ("every body is cut separately" in words) == ("(" in said)
