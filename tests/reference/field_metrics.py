"""The metrics of three published projects, written literally: loops over pixels, whole frames.

Frames are (height, width, channels, components) of s0, s1, s2 …; nothing here is of malus.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import convolve2d


def polaranything(estimate, truth, mask):
    """AoLP in degrees, DoLP (absolute and squared), and the pictures of their encoding."""
    angles, absolutes, squares = [], [], []
    pictures = np.zeros((2, *mask.shape, 3))
    for row, column in zip(*np.nonzero(mask), strict=True):
        pair = []
        for number, frame in enumerate((estimate, truth)):
            s0, s1, s2 = frame[row, column].mean(axis=0)[:3]
            degree = 0.0 if s0 <= 0 else min(max(math.hypot(s1, s2) / s0, 0.0), 1.0)
            angle = 0.5 * math.atan2(s2, s1)
            pair.append((degree, math.degrees(angle)))
            pictures[number, row, column] = (
                (math.sin(2 * angle) + 1) / 2,
                (math.cos(2 * angle) + 1) / 2,
                degree,
            )
        delta = abs(pair[0][1] - pair[1][1])
        angles.append(min(delta, 180.0 - delta))
        absolutes.append(abs(pair[0][0] - pair[1][0]))
        squares.append((pair[0][0] - pair[1][0]) ** 2)
    squared = np.mean((pictures[0] - pictures[1])[mask] ** 2)
    return {
        "polaranything_aolp_deg": np.mean(angles),
        "polaranything_dolp_mae": np.mean(absolutes),
        "polaranything_dolp_mse": np.mean(squares),
        "polaranything_psnr": decibels(1.0, squared),
    }


def rgb2pol(estimate, truth):
    """PSNR and SSIM of 8-bit codes, component by component, and their means."""
    values = {}
    for k in range(1, truth.shape[-1]):
        low, high = truth[..., k].min(), truth[..., k].max()
        if low == high:
            continue
        a, b = (np.clip((s[..., k] - low) / (high - low), 0, 1) * 255 for s in (estimate, truth))
        values[f"rgb2pol_psnr_s{k}"] = decibels(255.0, np.mean((a - b) ** 2))
        values[f"rgb2pol_ssim_s{k}"] = np.mean(
            [ssim(a[..., c], b[..., c], 255.0) for c in range(a.shape[-1])]
        )
    for name in ("psnr", "ssim"):
        parts = [v for key, v in values.items() if key.startswith(f"rgb2pol_{name}_s")]
        if parts:
            values[f"rgb2pol_{name}"] = np.mean(parts)
    return values


def polarscale(estimate, truth):
    """PSNR over everything, AoLP error where DoLP > 0.1, and the share of impossible pixels."""
    sigma = truth[..., 0].max()
    squared, angles, impossible, pixels = [], [], 0, 0
    for row in range(truth.shape[0]):
        for column in range(truth.shape[1]):
            for channel in range(truth.shape[2]):
                e, t = estimate[row, column, channel] / sigma, truth[row, column, channel] / sigma
                squared += [(a - b) ** 2 for a, b in zip(e[1:], t[1:], strict=True)]
                pixels += 1
                impossible += math.sqrt(sum(x * x for x in e[1:])) > e[0] * (1 + 1e-6)
                if t[0] > 0 and math.hypot(t[1], t[2]) / t[0] > 0.1:
                    turn = abs(math.degrees(math.atan2(e[2], e[1]) - math.atan2(t[2], t[1]))) / 2
                    angles.append(min(turn % 180, 180 - turn % 180))
    values = {
        "polarscale_psnr": decibels(1.0, np.mean(squared)),
        "polarscale_impossible": impossible / pixels,
        "polarscale_aolp_pixels": len(angles),
    }
    if angles:
        values["polarscale_aolp_deg"] = np.mean(angles)
    return values


def decibels(peak, mean_square):
    """20 log10(peak / RMSE); infinite where nothing differs."""
    return math.inf if mean_square == 0 else 20 * math.log10(peak / math.sqrt(mean_square))


def ssim_map(a, b, peak):
    """Structural similarity of one channel, 11 × 11 Gaussian of 1.5 pixels, full windows only."""
    x = np.arange(-5, 6)
    line = np.exp(-(x**2) / (2 * 1.5**2))
    window = np.outer(line, line) / line.sum() ** 2

    def smooth(picture):
        return convolve2d(picture, window, mode="valid")

    mean_a, mean_b = smooth(a), smooth(b)
    var_a, var_b = smooth(a * a) - mean_a**2, smooth(b * b) - mean_b**2
    covariance = smooth(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    return ((2 * mean_a * mean_b + c1) * (2 * covariance + c2)) / (
        (mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)
    )


def ssim(a, b, peak):
    """Mean of the map."""
    return ssim_map(a, b, peak).mean()
