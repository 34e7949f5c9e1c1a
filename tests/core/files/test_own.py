"""Objects that a command line names by file and name."""

import pytest

from crowd_env.core.files.own import load_own, names_own

pytestmark = pytest.mark.more


def test_objects_of_a_file_are_found(tmp_path):
    file = tmp_path / "things_of_my_own.py"
    file.write_text(
        "class Thing:\n    size = 3\n\n\nready = Thing()\n\n\nclass Wants:\n    def __init__(self, size):\n        pass\n"
    )
    assert names_own(f"{file}:Thing") and not names_own("nsm2")
    made, ready = load_own("--scheme", f"{file}:Thing"), load_own("--scheme", f"{file}:ready")
    assert made.size == ready.size == 3 and made is not ready
    broken = tmp_path / "a_broken_law_of_a_test.py"
    broken.write_text("import a_library_that_nobody_has\n")
    unimported = "cannot be imported: ModuleNotFoundError"
    for text, answer in (
        (f"{file}:Other", "has no Other"),
        (f"{file}:Wants", "Wants cannot be made without arguments"),
        (f"{tmp_path}/none.py:Thing", "there is no file"),
        (f"{broken}:Law", unimported),
    ):
        with pytest.raises(ValueError, match=answer):
            load_own("--scheme", text)
