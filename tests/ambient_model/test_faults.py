from ambient_model.faults import Fault, Refused, refuse


def test_one_fault_is_one_line() -> None:
    assert str(refuse("a.csv", "line 2", "is empty", "fill it")) == "a.csv: line 2: is empty; fill it"
    assert str(refuse("a.csv", "", "is empty", "fill it")) == "a.csv: is empty; fill it"


def test_several_faults_stand_under_their_file() -> None:
    refused = Refused("m.json", [Fault("name", "missing", "add it"), Fault("", "is odd", "mend it")])
    assert str(refused) == "m.json: 2 faults\n  name: missing; add it\n  is odd; mend it"
