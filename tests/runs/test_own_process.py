"""Runs in processes of their own."""

from driver.runs import own_process


def test_a_run_alone_says_why_it_fails(tmp_path):
    status, words = own_process.run_alone({"scene": "modle", "out": tmp_path / "run"})
    assert status == 2 and "modle" in words
