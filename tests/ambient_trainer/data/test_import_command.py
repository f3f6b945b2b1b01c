"""``ambient-trainer import``: status, what the terminal shows, and an output that survives a failure."""

from ambient_trainer.data.trace import load_trace

_MAP = (
    "time: {column: t, unit: s, not_increasing: drop}\ncolumns: {usb_degC: {from: a, unit: mdegC}, b_degC: b}\n"
    "bad_rows: drop\ndrop_rows: {b: out}\nconstants: {ambient_degC: 22}\n"
)
_TABLE = "t,a,b\n0,20000,\n1,21000,\n1,9,\n3,25000,\n4,warm,\n5,1,out\n6,1,out\n"


def test_what_came_in_was_left_out_and_is_assumed_is_shown(trainer, write, tmp_path):
    out, mapped = str(tmp_path / "o.csv"), write("m.yaml", _MAP)
    status, shown, error = trainer("import", write("a.csv", _TABLE), "--format", "csv", "--map", mapped, "-o", out)
    assert (status, error) == (0, "")
    lines = shown.splitlines()
    assert lines[0] == "3 rows, 3.00 s, median period 1.50 s, longest step 2.00 s"
    cells = [" ".join(line.split()) for line in lines[4:7]]
    assert cells == ["usb_degC 3 0 0 20 22 25", "b_degC 0 1 3 - - -", "ambient_degC 3 0 0 22 22 22"]
    assert lines[-5:] == [
        "dropped 2 of 7 rows: the map's 'drop_rows' names them",
        "dropped 1 of 7 rows: they cannot be read",
        "dropped 1 of 7 rows: their time did not increase",
        "assumed ambient_degC = 22 (not logged)",
        f"wrote {out}",
    ]
    assert load_trace(out).columns["usb_degC"].tolist() == [20.0, 21.0, 25.0]
