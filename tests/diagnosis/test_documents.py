"""docs/diagnosis.md has the rules as the program applies them."""

import importlib.util

import pytest
from paths import ROOT

from twin.diagnosis import judgement, rules

TABLES = {
    "screening": rules.SCREENING,
    "adoption": rules.ADOPTION,
    "revision": rules.REVISION,
    "explanation": rules.EXPLANATION,
}
DOCUMENT = (ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def fill_readme():
    spec = importlib.util.spec_from_file_location("fill_readme", ROOT / "benchmarks" / "fill_readme.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", TABLES)
def test_table_of_rules_is_that_of_the_code(fill_readme, name):
    hint = f"python benchmarks/fill_readme.py {name}"
    assert fill_readme.part(DOCUMENT, name) == judgement.markdown(TABLES[name]), hint


def test_every_rule_is_in_a_table():
    assert {rule.name for table in TABLES.values() for rule in table} == rules.RULES.keys()


def test_cells_hold_no_column_separator():
    for table in TABLES.values():
        for row in judgement.table_rows(table):
            assert not any("|" in cell for cell in row)
