"""Named choices among the options, on the command line and in files."""

from pathlib import Path

import pytest

from planfit.cli.parser import parse
from planfit.cli.refine import RefineArguments
from planfit.errors import OptionError
from planfit.lsq.robust import LossKind


@pytest.mark.parametrize("word", ["geman_mcclure", "GEMAN_MCCLURE", "Geman-McClure"])
def test_names_of_losses_in_any_case(word: str, tmp_path: Path) -> None:
    flags = ["scan", "-o", "out", "--adjust.points.loss.kind", word]
    of_flags = parse(RefineArguments, "refine", flags)
    config = tmp_path / "options.toml"
    config.write_text(f"[adjust.points.loss]\nkind = '{word}'\n")
    of_file = parse(RefineArguments, "refine", ["scan", "-o", "out", "--config", str(config)])
    for arguments in (of_flags, of_file):
        assert arguments.options.adjust.points.loss.kind is LossKind.GEMAN_MCCLURE


def test_a_loss_that_there_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(
        OptionError, match="one of squared, huber, cauchy, geman_mcclure, norm, found 'cubic'"
    ):
        parse(RefineArguments, "refine", ["s", "-o", "o", "--adjust.points.loss.kind", "cubic"])
    with pytest.raises(SystemExit):
        parse(RefineArguments, "refine", ["--help"])
    shown = capsys.readouterr().out
    assert "{squared,huber,cauchy,geman_mcclure,norm}" in shown
    assert "(default: cauchy)" in shown
    assert "CAUCHY" not in shown
