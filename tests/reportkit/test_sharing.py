"""The address of a book."""

from types import SimpleNamespace

import pytest

from reportkit.sphinx_extension.sharing import find_address


@pytest.mark.parametrize(
    ("urls", "base"),
    [
        ('Homepage = "https://growth.example/book"', "https://growth.example/book/"),
        ('Homepage = "https://growth.example/book/"', "https://growth.example/book/"),
        ('Homepage = "https://example.org/armsim/"', ""),
        ("", ""),
    ],
)
def test_address_comes_from_the_package_unless_it_is_a_placeholder(tmp_path, urls, base):
    (tmp_path / "pyproject.toml").write_text(
        f'[tool.reportkit]\nname = "growth"\n[project.urls]\n{urls}\n'
    )
    config = SimpleNamespace(html_baseurl="")
    find_address(SimpleNamespace(srcdir=tmp_path), config)
    assert config.html_baseurl == base


def test_address_in_the_settings_of_sphinx_wins(tmp_path):
    (tmp_path / "pyproject.toml").write_text('[tool.reportkit]\nname = "growth"\n')
    config = SimpleNamespace(html_baseurl="https://elsewhere.example/")
    find_address(SimpleNamespace(srcdir=tmp_path), config)
    assert config.html_baseurl == "https://elsewhere.example/"
