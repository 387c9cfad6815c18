"""Tests of the search for a browser; `tests/book` prints the book with it."""

import pytest
from playwright.sync_api import sync_playwright

from reportkit import pdf


@pytest.mark.parametrize("there", ["google-chrome", pdf.BROWSERS[-1]])
def test_browser_of_the_system_is_found(monkeypatch, there):
    monkeypatch.setattr(pdf.shutil, "which", lambda name: name if name == there else None)
    assert pdf.browser() == there


def test_browser_of_playwright_is_found_or_advised(monkeypatch, tmp_path):
    monkeypatch.setattr(pdf.shutil, "which", lambda name: None)
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="playwright install chromium"):
        pdf.browser()
    with sync_playwright() as playwright:
        own = pdf.Path(playwright.chromium.executable_path)
    own.parent.mkdir(parents=True)
    own.touch()
    assert pdf.browser() == str(own)
