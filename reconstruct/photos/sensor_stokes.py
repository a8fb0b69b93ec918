"""Stokes images from raw frames of polarisation cameras: demosaicing and nothing else."""

from __future__ import annotations

import numpy as np

from malus.reconstruct.photos.mosaic import demosaic
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import check_kind
from malus.scenes.polarisation import analyser
from malus.scenes.sensor_frame import SensorFrame


def demosaiced_stokes(frame: SensorFrame) -> Float32Array:
    """The Stokes image that a raw frame shows, by demosaicing and least squares over four angles.

    It knows of the sensor what its user knows: dark level, gain, exposure, and the polarisers as
    they are if `calibrated`, else as they should be.

    Parameters
    ----------
    frame : SensorFrame
        A raw frame, and the sensor that took it.

    Returns
    -------
    (height, width, channels, 3) array
        Stokes vectors, in the units of the scene's radiance.

    Raises
    ------
    InputError
        For what is no frame with its sensor.

    Examples
    --------
    >>> from malus.scenes.sensor import Sensor
    >>> from malus.scenes.sensor_frame import expose
    >>> vertical = np.tile([1.0, -1.0, 0.0], (8, 8, 1, 1))
    >>> frame = expose(vertical, Sensor(exposure=1e6, full_well=1e6, bit_depth=16))
    >>> demosaiced_stokes(frame)[4, 4, 0].round(2).tolist()
    [1.0, -1.0, 0.0]
    """
    check_kind("frame", frame, SensorFrame, "`malus.expose` makes one, and a dataset has them")
    sensor, channels = frame.sensor, frame.channels
    # demosaic: (4, height, width, 1 or 3) of a frame; all frames, or all colours, side by side
    pictures = np.concatenate(
        [demosaic(one.astype(np.float32), sensor.bayer) for one in frame.electrons], axis=-1
    )
    if sensor.bayer is not None:
        pictures = pictures[..., ["rgb".index(name) for name in channels.names]]
    scale = frame.exposure * np.array(channels.responses, dtype=np.float64)
    angles, ratio = np.array(sensor.assumed_angles_deg), sensor.assumed_extinction_ratio
    inverse = np.linalg.pinv(analyser(angles, ratio))
    stokes = np.einsum("sa,ayxc->yxcs", inverse, pictures / scale)
    return np.asarray(stokes, dtype=np.float32)
