"""Learned models through transformers: loaded by hub name or folder, or a message that says why not."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from planfit.errors import OptionError

INSTALL = "pip install 'planfit[learned]'"


def load_model(option: str, weights: str, class_name: str, model_type: str, device: str) -> Any:
    """A model of transformers in evaluation mode.

    Args:
        option: name of the option that asked for it, for messages.
        weights: a hub name (`owner/model`) or a folder with `config.json` and weights.
        class_name: its class in transformers.
        model_type: what the weights must say they are.
        device: `cpu`, `cuda`, or any other that torch knows.

    Raises:
        OptionError: the library or the weights cannot be had, are of another kind, or incomplete.
    """
    try:
        importlib.import_module("torch")  # transformers loads without it, and fails later
        transformers = importlib.import_module("transformers")
    except ImportError as error:
        raise OptionError(
            f"{option}: expected transformers and torch for learned keypoints, found no module "
            f"{error.name}; {INSTALL}, or use keypoints.kind sift"
        ) from error
    if _looks_like_folder(weights) and not Path(weights).expanduser().is_dir():
        raise OptionError(f"{option}: expected a folder with weights, found no folder {weights}")
    source = str(Path(weights).expanduser()) if Path(weights).expanduser().is_dir() else weights
    try:
        config = transformers.AutoConfig.from_pretrained(source)
        if config.model_type != model_type:
            raise OptionError(
                f"{option}: expected weights of {model_type}, found those of {config.model_type} "
                f"in {weights}"
            )
        with _no_bar(transformers.utils.logging):
            model, report = getattr(transformers, class_name).from_pretrained(
                source, config=config, output_loading_info=True
            )
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise OptionError(
            f"{option}: expected weights at {weights}, which is neither a folder that can be read nor "
            f"to be had from the hub ({reason}); download them where there is a network and give "
            "the folder"
        ) from error
    if report["missing_keys"]:
        missing = sorted(report["missing_keys"])
        raise OptionError(
            f"{option}: expected complete weights in {weights}, found {len(missing)} missing "
            f"(first {missing[0]}); download them again"
        )
    try:
        return model.to(device).eval()
    except (RuntimeError, AssertionError) as error:
        raise OptionError(
            f"device: expected one that torch can use, found {device!r} "
            f"({str(error).splitlines()[0]}); use cpu"
        ) from error


@contextmanager
def _no_bar(logging: Any) -> Iterator[None]:
    """Keep transformers from drawing a bar of its own while it loads: only the command line prints."""
    was_enabled = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        if was_enabled:
            logging.enable_progress_bar()


def _looks_like_folder(weights: str) -> bool:
    return weights.startswith((".", "/", "~")) or weights.count("/") != 1
