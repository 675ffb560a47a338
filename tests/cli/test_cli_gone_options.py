"""Options of earlier versions: one line says what became of each."""

import pytest

from planfit.cli.commands import COMMANDS_BY_NAME
from planfit.cli.gone_options import GONE_OPTIONS
from planfit.cli.main import main
from planfit.cli.parser import read_options
from planfit.errors import OptionError
from planfit.pipeline.options import RefineOptions
from planfit.runtime.option_values import option_names


def test_what_is_gone_is_no_option():
    assert not set(GONE_OPTIONS) & set(option_names(RefineOptions()))


@pytest.mark.parametrize("name", sorted(GONE_OPTIONS))
def test_a_file_that_names_a_gone_option_is_told_what_became_of_it(name, tmp_path):
    path = tmp_path / "options.toml"
    path.write_text(f"{name} = 1\n")
    with pytest.raises(OptionError) as caught:
        read_options(path, RefineOptions())
    assert str(caught.value).startswith(f"{path}: {name}: ")
    assert GONE_OPTIONS[name] in str(caught.value)


@pytest.mark.parametrize(
    "flag", ["--align.cell-m", "--align.cell_m=0.1", "--tracking.no-adapt-sigmas"]
)
def test_a_flag_that_is_gone_is_told_what_became_of_it(flag):
    with pytest.raises(OptionError, match="found one that is gone: "):
        COMMANDS_BY_NAME["refine"].check_flags(["SCAN", flag, "1"])


def test_a_gone_flag_ends_with_exit_code_2_and_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["refine", "SCAN", "-o", "OUT", "--align.min-score", "0.3"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "--align.min-score: " in told
    assert "planfit decides it" in told
