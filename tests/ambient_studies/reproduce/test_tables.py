"""Each published figure stands beside the simulated one of the same model, metric and scenario."""

from dataclasses import replace

from ambient_studies.reproduce.tables import overview_table, scenario_tables
from ambient_studies.reproduce.verdict import verdict


def test_the_pairs_have_the_thesis_numbers_in_its_order(made):
    pairs = scenario_tables(made().evaluated.rows)

    assert [pair.scenario for pair in pairs] == ["4", "1", "2.1", "3", "2.3", "2.4", "2.2", "2.5"]
    numbers = [f"Table 5.{number}:" for number in range(1, 13)]
    captions = [table.caption for pair in pairs[:6] for table in (pair.errors, pair.intervals)]
    assert [caption.split(" RMSE")[0].split(" where")[0] for caption in captions] == numbers
    assert all(pair.title.endswith("(simulated)") for pair in pairs)


def test_published_and_simulated_stand_side_by_side(made):
    pair = scenario_tables(made().evaluated.rows)[0]

    assert pair.errors.columns == (
        "model", "RMSE publ.", "RMSE sim.", "MAE publ.", "MAE sim.", "MBE publ.", "MBE sim.",
    )  # fmt: skip
    rows = {row[0]: row[1:] for row in pair.errors.rows}
    # the tenth model errs by 1 degC in half of the samples
    assert rows["Linear combined"] == ("1.00", "0.71", "0.80", "0.50", "0.10", "0.50")
    assert rows["Li et al. 2020, fixed point"][::2] == ("-", "-", "-")
    assert rows["Model 1 state-space single input, causal"][:2] == ("0.30", "0.21")
    assert rows["Model 1 state-space single input, non-causal"][:2] == ("0.30", "0.04")
    assert len(rows) == 10 + 1 + 4 + 2
    assert rows["Ours: circuit observer"][:2] == ("-", "0.01")
    assert list(rows)[-2:] == ["Ours: circuit observer", "Ours: free observer"]

    lines = [row for row in pair.intervals.rows if row[0] == "Linear combined" or row[1] == "simulated"]
    at = next(index for index, row in enumerate(pair.intervals.rows) if row[0] == "Linear combined")
    published, simulated = pair.intervals.rows[at : at + 2]
    assert published == ("Linear combined", "published", "-1.00 to 1.00", "-1.00 to 1.00", "-1.00 to 1.00")
    assert simulated[:2] == ("", "simulated")
    assert simulated[3] == "-0.33 to 1.33"
    assert len(lines) > 1


def test_scenarios_without_published_figures_say_so(made):
    charging = scenario_tables(made().evaluated.rows)[6]

    assert charging.errors.columns == ("model", "RMSE sim.", "MAE sim.", "MBE sim.")
    assert "The thesis recorded this scenario and gives no figures of it." in charging.errors.caption
    assert {row[1] for row in charging.intervals.rows} == {"simulated"}


def test_the_overview_has_a_row_a_variant_and_a_column_a_scenario(made):
    table = overview_table(made().evaluated.rows)

    assert table.columns == ("method", "variant", "1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4")
    assert len(table.rows) == 17
    assert [row[:2] for row in table.rows[-2:]] == [
        ("Ours: circuit observer", "ours"),
        ("Ours: free observer", "ours"),
    ]
    assert ("Model 1 state-space single input", "non-causal", *["0.04"] * 8) in table.rows


def test_the_verdict_says_what_falls_short(made, published_result):
    rows = list(made().evaluated.rows)
    found = verdict(rows)
    assert found.compared == 60
    assert "rank alike with a Spearman correlation of 0.9" in found.headline
    assert any("the wanted 0.85" in each for each in found.shortfalls) == (found.spearman < 0.85)

    (index,) = [
        k for k, row in enumerate(rows) if (row.scenario, row.model, row.variant) == ("4", "linear_usb", "corrected")
    ]
    rows[index] = replace(rows[index], published=published_result(30.0))
    worse = verdict(rows)
    assert "Scenario 4, Linear USB: RMSE 0.57 degC simulated, 30.00 published." in worse.shortfalls
    assert worse.within_factor_two == found.within_factor_two - 1
    best = "Scenario 4: the thesis's best is Model 1 Kirchhoff, the simulated phone's Model 1 state-space single input."
    assert best in worse.shortfalls

    rows[index] = replace(rows[index], reproduced=None)
    assert "Scenario 4, Linear USB: no finite figure." in verdict(rows).shortfalls


def test_a_bad_correlation_is_not_hidden(made, published_result):
    rows = [
        row if row.published is None else replace(row, published=published_result(1 / row.published.rmse_degC))
        for row in made().evaluated.rows
    ]
    found = verdict(rows)
    assert found.spearman < 0
    assert found.shortfalls[0] == (f"The rank correlation of {found.spearman:.2f} falls short of the wanted 0.85.")
