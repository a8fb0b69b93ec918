"""The methods by name: those that malus brings, installed ones, and objects of your own."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType

import numpy as np

from malus.reconstruct.checked_components import checked_components
from malus.reconstruct.observation import INPUTS, Components, Inapplicable, Observation
from malus.scenes.core.errors import InputError
from malus.scenes.core.named_file import digest_of
from malus.scenes.core.registry import several
from malus.scenes.core.validation import near

ENTRY_POINTS = "malus.methods"


@dataclass(frozen=True)
class Method:
    """A way to reconstruct polarisation from one unpolarised image.

    Attributes
    ----------
    name : str
        What suites, `--method` and tables call it.
    needs : frozenset of str
        Attributes of `Observation` that are filled in for it, besides image and mask.
    reconstruct : function of an Observation that returns Components
    summary : str
        One line for `malus list`.
    per_pixel : bool
        The components of a pixel follow from that pixel and from what all pixels share, and
        several threads may call the function at once. It may then be given the pixels of the mask
        alone, in rows that are no picture.
    per_band : bool
        The components of a band follow from that band, its index and what all bands share. Where
        `per_pixel` holds too, the bands of several scenes may be given side by side.
    optional : frozenset of str
        Attributes of `Observation` that it estimates itself, and uses where they are given.

    Raises
    ------
    InputError
        A name that is no text, needs that no method can have, or no function.

    Examples
    --------
    >>> def half(observation):
    ...     return Components(observation.image, 0.5 * observation.image, 0 * observation.image)
    >>> method = Method("half", frozenset(), half, "half of the light is polarised horizontally")
    >>> method.reconstruct(Observation(np.ones((1, 1, 1)), np.ones((1, 1), bool))).i_max.item()
    0.75
    """

    name: str
    needs: frozenset[str]
    reconstruct: Callable[[Observation], Components]
    summary: str
    per_pixel: bool = False
    per_band: bool = False
    optional: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        """Check it, before anything is rendered for it; a list of names, or one, is a set."""
        if not isinstance(self.name, str) or not self.name.strip():
            raise InputError("method", "a name", repr(self.name), "give it one, in a word")
        if not callable(self.reconstruct):
            hint = "give a function of an Observation that returns Components"
            raise InputError(f"method {self.name}", "a function", repr(self.reconstruct), hint)
        for field in ("needs", "optional"):
            own = frozenset(several(getattr(self, field)))
            object.__setattr__(self, field, own)
            if unknown := sorted(map(str, own - INPUTS)):
                expected, found = f"some of {', '.join(sorted(INPUTS))}", ", ".join(unknown)
                hint = near(found, INPUTS) or "image, mask and wavelengths_nm are always there"
                raise InputError(f"method {self.name}, {field}", expected, found, hint)


def _unpolarised(observation: Observation) -> Components:
    """The image without any polarised part."""
    image = observation.image
    return Components(image, np.zeros_like(image), np.zeros_like(image))


TRIVIAL = Method(
    "unpolarised",
    frozenset(),
    _unpolarised,
    "the trivial guess: half of I at every angle",
    per_pixel=True,
    per_band=True,
)
"""The method that skill is measured against."""


def methods() -> dict[str, Method]:
    """All methods by name: those that malus brings, and the entry-point group `malus.methods`.

    Raises
    ------
    InputError
        If an installed entry point does not load, or is no Method.

    Examples
    --------
    >>> "eq8" in methods()
    True
    """
    return dict(_methods())


@functools.cache
def _methods() -> dict[str, Method]:
    """The same, kept."""
    # Imported only now, because it takes long and `import malus.reconstruct` does not need it.
    from malus.reconstruct.builtin_methods import whole_picture_methods

    whole_picture = {
        name: Method(name, needs, reconstruct, summary, optional=optional)
        for name, needs, reconstruct, summary, optional in whole_picture_methods()
    }
    installed = {
        entry.name: _loaded(f"entry point {entry.name}", entry.value) for entry in _installed()
    }
    return _per_pixel() | whole_picture | installed


@functools.cache
def _per_pixel() -> dict[str, Method]:
    """Methods of malus that work pixel by pixel, by name."""
    from malus.reconstruct.builtin_methods import per_pixel_methods

    declared = (Method(*entry, per_pixel=True, per_band=True) for entry in per_pixel_methods())
    return {method.name: method for method in (TRIVIAL, *declared)}


@functools.cache
def _installed() -> tuple[importlib.metadata.EntryPoint, ...]:
    """Entry points of methods; kept, because looking them up takes as long as scoring a method."""
    return tuple(importlib.metadata.entry_points(group=ENTRY_POINTS))


def get_method(name: str) -> Method:
    """The method of that name, the object `package.module:object`, or a network `net:FILE.onnx`.

    Parameters
    ----------
    name : str
        Of a method in `list_methods`, of an object, or of a file of weights.

    Returns
    -------
    Method
        The method, ready to be called.

    Raises
    ------
    InputError
        If there is none, the object is no Method, or the file of weights is missing or damaged.

    Examples
    --------
    >>> get_method("eq8").needs == {"specular", "diffuse", "normals", "eta", "alpha"}
    True
    >>> get_method("malus.reconstruct.methods:TRIVIAL").name
    'unpolarised'
    """
    if not isinstance(name, str):
        hint = "name one of `malus list methods`, or package.module:object"
        raise InputError("method", "the name of a method", f"{type(name).__name__}", hint)
    if name.startswith(_NETWORKS) and name.endswith(".onnx"):
        return _of_file(name)
    if ":" in name:
        return _loaded(f"method {name}", name)
    if name in _per_pixel() and all(entry.name != name for entry in _installed()):
        return _per_pixel()[name]  # without those of whole pictures, which take longer to import
    known = _methods()
    if name not in known:
        hint = near(name, known) or "`malus list methods` shows them; your own is module:object"
        raise InputError("method", f"one of {', '.join(known)}", name, hint)
    return known[name]


_NETWORKS = ("net:", "net-around:")


def _of_file(name: str) -> Method:
    """The method of one's own file of weights; its name in tables is the reference itself."""
    from malus.reconstruct.learned.net import net_of_file

    # What is wrong with the file is told now; without the runtime, where it is first run.
    reconstruct, summary = net_of_file(name)
    return Method(name, frozenset(), reconstruct, summary)


def _loaded(where: str, reference: str) -> Method:
    """The Method that `package.module:object` refers to; InputError if there is none."""
    module, _, attribute = reference.partition(":")
    try:
        loaded = getattr(_imported(module), attribute)
    except InputError:
        raise  # of a Method there that is none
    except (Exception, SystemExit) as error:  # a module raises anything
        if isinstance(error, SystemExit) and error.code in _STOPPED:
            raise
        found, hint = _why_not_imported(module, error), "check that it can be imported"
        raise InputError(where, "package.module:object", found, hint) from None
    if not isinstance(loaded, Method):
        expected, hint = "a malus.reconstruct.Method", "guides/methods.md shows one"
        raise InputError(where, expected, type(loaded).__name__, hint)
    return guarded(loaded)


def _why_not_imported(module: str, error: BaseException) -> str:
    """What a module of one's own raised, and at which of its lines."""
    message = " ".join(str(error).split())
    if isinstance(error, ImportError | AttributeError | ValueError | SyntaxError):
        return message  # which says it in words, and where a syntax is wrong
    place = _last_place(traceback.extract_tb(error.__traceback__), str(_module_file(module)))
    return f"{type(error).__name__}{f' ({place})' if place else ''}: {message}"


def guarded(method: Method) -> Method:
    """A method of one's own: given arrays of its own, and refused what is no picture of the same.

    What it writes into changes no truth. It raises InputError where it returns no Components,
    or arrays of another shape than the image's, of no real numbers or masked on the object; those
    of any real type are single or double precision behind it. What else it raises has a note of the
    line in its file; where it would end the program, it fails likewise.

    Examples
    --------
    >>> wrong = Method("wrong", frozenset(), lambda seen: seen.image, "no Components")
    >>> guarded(wrong).reconstruct(Observation(np.ones((2, 2, 3)), np.ones((2, 2), bool)))
    Traceback (most recent call last):
    ...
    malus.scenes.core.errors.InputError: method wrong: expected Components, found ndarray; ...
    """
    if getattr(method.reconstruct, "func", None) is _guarded:
        return method
    return replace(method, reconstruct=functools.partial(_guarded, method))


_STOPPED = (129, 143)
"""Codes of the exit where malus is stopped meanwhile: by a closed terminal and by SIGTERM."""


def _guarded(method: Method, observation: Observation) -> Components:
    """What a method of one's own makes of arrays of its own, which it may change."""
    ended = None
    try:
        returned = method.reconstruct(observation.with_own_arrays())
    except (InputError, Inapplicable):
        raise
    except Exception as error:
        if place := _place_in_method(error):
            error.add_note(place)
        raise
    except SystemExit as leaving:
        if leaving.code in _STOPPED:
            raise
        ended = RuntimeError(f"SystemExit, with {leaving.code!r}: it would end the whole program")
        ended.add_note(_place_in_method(leaving))
    if ended is not None:  # raised here, without the exit as its context
        raise ended
    return checked_components(method.name, returned, observation)


def _place_in_method(error: BaseException) -> str:
    """File and line of a method of one's own at which it failed, or called what failed."""
    called = traceback.extract_tb(error.__traceback__)[1:]  # after the call in `_guarded`
    return _last_place(called, called[0].filename) if called else ""


def _last_place(frames: Sequence[traceback.FrameSummary], file: str) -> str:
    """The last line of a file among the frames of a traceback; empty where there is none."""
    own = [frame for frame in frames if frame.filename == file]
    return f"{Path(file).name}, line {own[-1].lineno}" if own else ""


def by_name(called: Iterable[tuple[str, str]]) -> dict[str, str]:
    """How each method is called, by its name; of pairs of name and call.

    Raises
    ------
    InputError
        Where two methods have one name: their scores could not be told apart.

    Examples
    --------
    >>> by_name([("eq8", "eq8"), ("mine", "my_method:mine"), ("eq8", "eq8")])
    {'eq8': 'eq8', 'mine': 'my_method:mine'}
    """
    calls: dict[str, str] = {}
    for name, call in called:
        if calls.setdefault(name, call) != call:
            found = f"{name} for {calls[name]} and {call}"
            raise InputError("methods", "a name of its own for each", found, "rename one of them")
    return calls


_contents: dict[str, str] = {}
"""Digest of the file of each module when malus loaded it."""


def _imported(module: str) -> ModuleType:
    """A module; loaded anew where its file has changed since malus loaded it."""
    source = _module_file(module)
    content = digest_of(source, "method") if source.is_file() else ""
    changed = _contents.get(module, content) != content
    with _working_folder():
        if changed and module in sys.modules:
            # Python takes compiled code of an equal size and second for that of the same file.
            with suppress(OSError, NotImplementedError):
                Path(importlib.util.cache_from_source(str(source))).unlink(missing_ok=True)
            loaded = importlib.reload(sys.modules[module])
        else:
            loaded = importlib.import_module(module)
    _contents[module] = content
    return loaded


@contextmanager
def _working_folder() -> Iterator[None]:
    """Modules may lie in the working folder."""
    folder = os.getcwd()
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        # Not pop(0): an imported module may have put a folder of its own before this one.
        sys.path.remove(folder)


def source_of(name: str) -> Path | None:
    """The file that decides what a method says and that may change while malus stays the same.

    Returns
    -------
    Path
        The weights of a network, the module of a method of one's own; it need not exist. None for
        other methods of malus: its version tells.

    Examples
    --------
    >>> source_of("eq8"), source_of("net:mine.onnx").name
    (None, 'mine.onnx')
    >>> source_of("malus.reconstruct.methods:TRIVIAL").name
    'methods.py'
    """
    from malus.reconstruct.learned.net import is_network, weights_of
    from malus.reconstruct.learned.network import WEIGHTS

    if is_network(name) and (":" not in name or name.endswith(".onnx")):
        return weights_of(name) or WEIGHTS
    installed = {entry.name: entry.value for entry in _installed()}
    reference = name if ":" in name else installed.get(name)
    return None if reference is None else _module_file(reference.partition(":")[0])


def _module_file(module: str) -> Path:
    """The file of a module, of which only the packages around it are imported."""
    found = None
    package = module.rpartition(".")[0]
    with suppress(Exception), _working_folder():  # a package raises anything
        folders = importlib.import_module(package).__path__ if package else None
        # In another working folder the same name may be another file than the one that is loaded.
        found = PathFinder.find_spec(module, folders) or importlib.util.find_spec(module)
    return Path(module if found is None or found.origin is None else found.origin)
