"""Open a dataset in whichever form it is stored: folders of scenes, shards, or one HDF5 file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.dataset_record import DATASET
from malus.renderers.datasets.hdf5 import HDF5, Hdf5File
from malus.renderers.datasets.samples import Samples, SampleSource
from malus.renderers.datasets.shards import SHARDS, Shards
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import MISSING
from malus.scenes.core.remote import as_path, is_here


def open_dataset(
    folder: Path | str,
    split: str | None = None,
    *,
    maps: Sequence[str] | str | None = None,
    crop: int | None = None,
    seed: int = 0,
) -> Dataset | Samples:
    """Open a dataset that malus rendered or exported, for its truths or for training.

    Parameters
    ----------
    folder : path or URL of a folder
        Of a dataset, or of its export as `webdataset` or `hdf5`.
    split : str, optional
        Only the scenes of this split, such as "train".
    maps : names of arrays, one name, or "all", optional
        What each sample holds; by default image, stokes, mask and normals. Beside the truth's
        arrays (`s3` too, zero where there is none) these are the dataset's maps (`eta` is always
        complex), and of its polarisation camera `sensor`, the Stokes image, and `raw` (height,
        width, frames).
    crop : int, optional
        Side of a square that is cut out of every picture at random.
    seed : int
        Of the crops.

    Returns
    -------
    Dataset or Samples
        Both have a length, and `[index]` gives a dictionary of arrays. A Dataset, where nothing is
        chosen and the folder holds whole truths, reads these too; Samples, for training, fit a
        PyTorch DataLoader as they are: they are pickled without open files, and nothing is read
        before it is asked for.

    Raises
    ------
    InputError
        A folder without a dataset, or with a damaged one; a split or an array that it lacks; a
        crop larger than its pictures.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> done = malus.render_dataset("quick", folder, resolution=12, samples=2)
    >>> samples = malus.open_dataset(folder, maps=("image", "stokes"), crop=8)
    >>> samples[0]["stokes"].shape
    (8, 8, 3, 3)
    """
    opened = as_path(folder)
    exported = _exported(opened)
    if exported is not None:
        return Samples.of(exported, split, maps, crop, seed)
    try:
        dataset = open_folder(opened)
    except InputError as error:
        if (opened / DATASET).exists():
            raise
        expected = f"{DATASET}, {SHARDS} or {HDF5}"
        if not is_here(opened) and error.found != MISSING:  # the store does not answer
            raise
        hint = "`malus render` and `malus export` make them"
        raise InputError(str(folder), expected, "none of them", hint) from error
    if split is None and maps is None and crop is None and seed == 0:
        return dataset
    return dataset.samples(split, maps, crop, seed)


def _exported(folder: Path) -> SampleSource | None:
    """The export in a folder, or the file itself."""
    if not is_here(folder) and ((folder / SHARDS).exists() or (folder / HDF5).exists()):
        expected, hint = "shards or HDF5 on this machine", "copy the folder here first"
        raise InputError(str(folder), expected, "a store elsewhere", hint)
    if (folder / SHARDS).exists():
        return Shards(folder)
    for path in (folder / HDF5, folder):
        if path.suffix == ".h5" and path.is_file():
            return Hdf5File(path)
    return None
