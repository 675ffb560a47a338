"""Learned models through transformers, by hub name or folder; or a message that says why not.

The libraries are loaded only where a model is asked for: they take seconds, and are an extra.
"""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planfit.errors import OptionError

_INSTALL = "pip install 'planfit[learned]'"


@dataclass(frozen=True)
class Weights:
    """Weights that were found, with what they say they are."""

    where: str
    """The option and its value, as messages begin."""
    source: str
    """Folder or hub name, as transformers takes it."""
    config: Any
    torch: Any
    transformers: Any


def find_weights(option: str, name: str, instead: str) -> Weights:
    """The weights that an option names, without loading them.

    Args:
        option: its name, for messages.
        name: hub name (`owner/model`), or folder with `config.json` and weights.
        instead: what works without the libraries, for messages.

    Raises:
        OptionError: the libraries are not installed, or there are no such weights.
    """
    where, path = f"{option}: {name}", Path(name).expanduser()
    is_path = path.is_absolute() or name.startswith((".", "~")) or len(path.parts) > 2
    if is_path and not path.is_dir():
        raise OptionError(
            f"{where}: expected a folder with config.json and weights, found no such folder; check the "
            "path, or give the name of a model on the Hugging Face hub"
        )
    try:
        torch = importlib.import_module("torch")  # transformers loads without it, and fails later
        transformers = importlib.import_module("transformers")
    except ImportError as error:
        raise OptionError(
            f"{option}: needs the library {error.name}, which is not installed; run `{_INSTALL}`, or "
            f"use {instead}"
        ) from error
    source = str(path) if path.is_dir() else name
    try:
        config = transformers.AutoConfig.from_pretrained(source, trust_remote_code=False)
    except (OSError, ValueError, KeyError) as error:
        raise OptionError(
            f"{where}: expected a folder with config.json and weights, or a model on the Hugging Face "
            f"hub, found neither ({first_line(error)}); without network, fetch the model elsewhere and "
            "give its folder"
        ) from error
    return Weights(where, source, config, torch, transformers)


def load_model(
    weights: Weights, model_class: Any, what: str, device_option: str, device: str,
    not_saved: tuple[str, ...] = (),
) -> tuple[Any, Any]:  # fmt: skip
    """A model in evaluation mode, and the device that it is on.

    Args:
        weights: as found.
        model_class: of transformers.
        what: what the model is to be, for messages.
        device_option: name of the option `device`, for messages.
        device: `cpu`, `cuda`, `cuda:1` and so on; `auto` takes a GPU where there is one.
        not_saved: beginnings of the names of weights that may be missing.

    Raises:
        OptionError: the weights cannot be read or are not complete, or there is no such device.
    """
    where = weights.where
    try:
        with _no_bar(weights.transformers.utils.logging):
            model, loaded = model_class.from_pretrained(
                weights.source,
                config=weights.config,
                output_loading_info=True,
                # Tensors alone, whatever the file: no pickles, no code that comes with a model.
                weights_only=True,
                trust_remote_code=False,
            )
    except (OSError, ValueError, KeyError, ImportError, RuntimeError) as error:
        raise OptionError(
            f"{where}: expected the weights of {what}, found a {weights.config.model_type} that cannot "
            f"be loaded ({first_line(error)}); download it again"
        ) from error
    # transformers would fill these with random numbers and go on.
    missing = sorted(k for k in loaded["missing_keys"] if not k.startswith(not_saved))
    if missing:
        raise OptionError(
            f"{where}: expected all weights of {what}, found none for {missing[0]} and "
            f"{len(missing) - 1} more; download them again, or take a model that was trained as such, "
            "not its backbone"
        )
    found = _device(weights.torch, device_option, device)
    return model.to(found).eval(), found


def first_line(error: Exception) -> str:
    """What an error says, short enough for a message of one line."""
    text = str(error).strip()
    return text.split("\n")[0][:200] if text else type(error).__name__


def _device(torch: Any, option: str, name: str) -> Any:
    """The device of that name, once something was put on it; `auto` takes a GPU where there is one."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise OptionError(
            f"{option}: expected auto, cpu or a GPU that PyTorch sees, found {name!r} "
            f"({first_line(error)})"
        ) from error
    return device


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
