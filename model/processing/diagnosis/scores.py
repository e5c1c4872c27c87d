"""Normal equations of the joint fit of all faults, and how much their right side scatters from tile to tile."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from model.processing.diagnosis.causes import PER_FRAME, SHARED
from model.processing.diagnosis.rounding import RoundedParts
from model.processing.diagnosis.samples import BLOCK_PIXELS, Samples
from model.special_functions import fdtri

FloatArray = NDArray[np.float64]

# Tiles are this many blocks wide: wider than blur and mosaics reach; in large pictures wider, so that they stay few.
_TILE_BLOCKS, _LARGE_TILE_BLOCKS, _LARGE_BLOCKS = 3, 5, 8000
# Coarser tiles are made of 2 x 2, 4 x 4 ... of them while there are at least so many.
_LEAST_COARSE_TILES = 4
# That coarse tiles of nothing but noise scatter by more than is taken for chance.
_CHANCE = 0.01
# Of the scaled covariance of scores: directions below are sums of others, to rounding.
_RANK_TOLERANCE = 1e-8
# Of the information of a shift that can be taken for noise of slopes.
_MOST_NOISE = 0.98
# Of the light: pictures without any noise are computed ones, whose residual is that of rounding.
_LEAST_NOISE = 1e-7
# Times the number of tiles that a covariance is known at most.
_MOST_FREEDOM = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """Sums over tiles: information A and right side b of A x = b.

    Attributes
    ----------
    information : (T, P, P) array
        Of each tile.
    right : (T, P) array
        Of each tile.
    expected_covariance : (P, P) array
        Of the sum of the right sides, were the residuals of blocks independent with the variance of their weight.
    rounding_covariance : (P, P) array
        Of the same by rounding.
    grid : (int, int)
        Tiles down and across.
    """

    information: FloatArray
    right: FloatArray
    expected_covariance: FloatArray
    rounding_covariance: FloatArray
    grid: tuple[int, int]

    @property
    def tiles(self) -> int:
        """Number of tiles that hold anything."""
        return int(np.count_nonzero(np.einsum("tii->t", self.information) > 0.0))


def tile_scores(null_basis: FloatArray, samples: Samples, parts: RoundedParts | None = None) -> Scores:
    """Return the normal equations of every tile, weighted by the noise that the residual shows.

    Parameters
    ----------
    null_basis
        Of the design, shape (N, N - 3).
    samples
        Block means.
    parts
        Pixels whose rounding is the same; None where noise makes it harmless.
    """
    frames = len(null_basis)
    side = _LARGE_TILE_BLOCKS if samples.pixels.size > _LARGE_BLOCKS else _TILE_BLOCKS
    weights = samples.pixels / _variance_of_a_pixel(samples)
    features, grid = _tiled(samples.features, side)
    instruments, _ = _tiled(samples.instruments, side)
    residual, _ = _tiled(samples.residual, side)
    weight, _ = _tiled(weights[None], side)
    onto = null_basis @ null_basis.T
    repeats = features.shape[1] // frames
    products = np.matmul(instruments * weight, features.transpose(0, 2, 1)) * np.tile(onto, (repeats, repeats))
    products -= _of_noise_in_slopes(samples, weights, onto, products, np.count_nonzero(weight[:, 0] > 0.0, axis=1))
    rights = np.sum(instruments * weight * np.tile(residual, (1, repeats, 1)), axis=2)
    gather = _gathered(frames)
    rounded = 0.0 * products[0] if parts is None else _rounding_covariance(samples, weights, onto, parts)
    return Scores(
        information=np.asarray(gather @ products @ gather.T),
        right=np.asarray(rights @ gather.T),
        expected_covariance=np.asarray(gather @ _expected_covariance(samples, weights) @ gather.T),
        rounding_covariance=np.asarray(gather @ rounded @ gather.T),
        grid=grid,
    )


def _of_noise_in_slopes(
    samples: Samples, weights: FloatArray, onto: FloatArray, products: FloatArray, blocks: NDArray[np.intp]
) -> FloatArray:
    """Return what the noise of slopes, which are their own instruments, adds to the information of each tile."""
    frames, held = len(onto), weights > 0.0
    added = np.zeros_like(products)
    redundancy = round(float(np.trace(onto)))
    first = PER_FRAME.index("shift x") * frames
    for way, slopes in enumerate(samples.residual_slopes):
        squares = np.sum(slopes[:, held] ** 2, axis=0) * weights[held] / redundancy
        # The median of a mean of squares (Wilson and Hilferty 1931): blocks with edges of their own do not count.
        noise = float(np.median(squares)) / (1.0 - 2.0 / (9.0 * redundancy)) ** 3 if held.any() else 0.0
        own = slice(first + way * frames, first + (way + 1) * frames)
        share = noise * (np.eye(frames) - onto) * onto
        most = _MOST_NOISE * np.maximum(np.diag(products[:, own, own].sum(axis=0)), 0.0)
        wanted = np.diag(share) * blocks.sum()
        kept = np.divide(most, wanted, out=np.ones_like(wanted), where=wanted > most)
        added[:, own, own] = blocks[:, None, None] * share * float(kept.min())
    return added


def _expected_covariance(samples: Samples, weights: FloatArray) -> FloatArray:
    """Return the covariance of the right sides of independent blocks, the frames correlated as residuals are."""
    held = weights > 0.0
    residual = samples.residual[:, held] * np.sqrt(weights[held])
    between = residual @ residual.T / max(int(np.count_nonzero(held)), 1)
    instruments = samples.instruments[:, held]
    repeats = len(instruments) // len(between)
    return np.asarray((instruments * weights[held]) @ instruments.T * np.tile(between, (repeats, repeats)))


def _rounding_covariance(samples: Samples, weights: FloatArray, onto: FloatArray, parts: RoundedParts) -> FloatArray:
    """Return the covariance of the right sides by rounding: pixels of the same counts in all frames are off alike."""
    height, width = (BLOCK_PIXELS * side for side in weights.shape)
    rows, columns = np.nonzero(parts.numbers[:height, :width] >= 0)
    block = (rows // BLOCK_PIXELS) * weights.shape[1] + columns // BLOCK_PIXELS
    each = np.divide(weights, samples.pixels, out=np.zeros_like(weights), where=weights > 0.0).ravel()[block]
    part = parts.numbers[rows, columns]
    instruments = samples.instruments.reshape(len(samples.instruments), -1)
    sums = np.array([np.bincount(part, weights=each * row[block]) for row in instruments])
    repeats = len(instruments) // len(onto)
    return np.asarray(sums @ sums.T * np.tile((onto * parts.errors**2) @ onto, (repeats, repeats)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoreCovariance:
    """Covariance of the sum of the right sides, shape (P, P), and of how many tiles' worth it is known."""

    covariance: FloatArray
    freedom: float


def score_covariance(scores: Scores, parameters: FloatArray, fitted: FloatArray) -> ScoreCovariance:
    """Return the covariance of the sum of the right sides, from what a fit leaves in tiles.

    Parameters
    ----------
    scores
        Of the tiles.
    parameters
        Of the fit, shape (P,).
    fitted
        Directions that were fitted, shape (P, Q); a tile is held against the fit to the other tiles.

    Notes
    -----
    Few tiles cannot tell the covariance of many parameters: what they show is shrunk towards that of independent
    blocks, the more the less the tiles agree (Ledoit and Wolf 2004, J. Multivariate Anal. 88, 365). Tiles are taken as
    independent. Where coarser tiles scatter by more than that allows (shading, fringes), the errors of the parameters
    concerned are widened to what the coarser ones show.
    """
    left = _left_out(scores.information, scores.right - scores.information @ parameters, fitted)
    shrunk = _shrunk(left, scores.expected_covariance)
    factor = _widening(left.reshape(*scores.grid, -1), np.diag(_scatter(left)))
    return replace(shrunk, covariance=shrunk.covariance * factor[:, None] * factor[None, :])


def _left_out(information: FloatArray, left: FloatArray, fitted: FloatArray) -> FloatArray:
    """Return what a fit to all other tiles leaves in each (the jackknife, without a fit for each)."""
    if not fitted.shape[1]:
        return left
    of_tiles = information @ fitted
    own = fitted.T @ of_tiles
    others = own.sum(axis=0) - own
    size = np.sqrt(np.abs(np.diag(own.sum(axis=0))))
    if not np.all(size > 0.0):
        return left
    scaled = others / np.outer(size, size)
    moved = np.linalg.pinv(scaled, rcond=1e-6) @ ((left @ fitted) / size)[:, :, None]
    return np.asarray(left + np.einsum("tpq,tq->tp", of_tiles / size, moved[:, :, 0]))


def _shrunk(left: FloatArray, expected: FloatArray) -> ScoreCovariance:
    """Return the scatter of tiles, shrunk towards what is expected of them."""
    held = left[np.any(left != 0.0, axis=1)]
    count = len(held)
    size = np.sqrt(np.maximum(np.diag(expected), 0.0))
    if count < 2 or not np.any(size > 0.0):
        return ScoreCovariance(covariance=np.zeros_like(expected), freedom=1.0)
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(expected / np.outer(scale, scale))
    kept = values > _RANK_TOLERANCE * float(values[-1])
    back = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    white = (held - held.mean(axis=0)) / scale @ (vectors[:, kept] / np.sqrt(values[kept]))
    white *= np.sqrt(count / (count - 1.0))
    scatter = white.T @ white
    level = float(np.trace(scatter)) / len(scatter)
    even = level * np.eye(len(scatter))
    chance = float(np.sum(np.sum(white**2, axis=1) ** 2)) - float(np.sum(scatter**2)) / count
    apart = float(np.sum((scatter - even) ** 2))
    share = float(np.clip(chance / apart, 0.0, 1.0)) if apart > 0.0 else 1.0
    return ScoreCovariance(
        covariance=np.asarray(back @ ((1.0 - share) * scatter + share * even) @ back.T),
        freedom=min(count / max((1.0 - share) ** 2, 1e-9), _MOST_FREEDOM * count),
    )


def _widening(coarse: FloatArray, own: FloatArray) -> FloatArray:
    """Return the factor of each parameter's error, from the scatter of coarser tiles."""
    widening, tiles = np.ones(len(own)), int(np.count_nonzero(np.any(coarse != 0.0, axis=2)))
    while (coarse := _merged(coarse)).shape[0] * coarse.shape[1] >= _LEAST_COARSE_TILES:
        flat = coarse.reshape(-1, coarse.shape[-1])
        ratio = np.diag(_scatter(flat)) / np.where(own > 0.0, own, np.inf)
        # What independent tiles exceed by chance is no widening.
        by_chance = float(fdtri(len(flat) - 1, max(tiles - 1, 1), 1.0 - _CHANCE))
        widening = np.where(ratio > by_chance, np.maximum(widening, ratio), widening)
    return np.sqrt(widening)


def _scatter(scores: FloatArray) -> FloatArray:
    held = scores[np.any(scores != 0.0, axis=1)]
    count = len(held)
    if count < 2:
        return np.zeros((scores.shape[1], scores.shape[1]))
    centred = held - held.mean(axis=0)
    return np.asarray(centred.T @ centred * (count / (count - 1.0)))


def _merged(scores: FloatArray) -> FloatArray:
    padded = np.pad(scores, ((0, scores.shape[0] % 2), (0, scores.shape[1] % 2), (0, 0)))
    rows, columns = padded.shape[0] // 2, padded.shape[1] // 2
    return np.asarray(padded.reshape(rows, 2, columns, 2, -1).sum(axis=(1, 3)))


def _variance_of_a_pixel(samples: Samples) -> FloatArray:
    """Return the variance that one pixel's residual shows, block by block: of a level, of the light and at edges."""
    held = samples.pixels > 0
    squares = (np.mean(samples.residual**2, axis=0) * samples.pixels)[held]
    light = np.clip(samples.light[held], 0.0, None)
    parts = np.column_stack([np.ones_like(light), light, light**2, samples.steepness[held]])
    if not held.any():
        return np.full(samples.pixels.shape, np.inf)
    level = float(np.median(squares)) / 0.455 + (_LEAST_NOISE * float(light.max())) ** 2 + 1e-300
    sizes = parts.max(axis=0) + (parts.max(axis=0) == 0.0)
    expected = np.full_like(light, level)
    for _ in range(3):
        # Blocks far off what is expected (things that moved) do not make the noise.
        kept = np.minimum(squares, 9.0 * expected)
        found = _nonnegative_fit(parts / sizes / expected[:, None], kept / expected)
        expected = np.maximum(parts / sizes @ found, 0.05 * level)
    variance = np.full(samples.pixels.shape, np.inf)
    variance[held] = expected
    return variance


def _nonnegative_fit(system: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least-squares solution without negative parts; of so few parts every choice can be tried."""
    count = system.shape[1]
    gram, right = system.T @ system, system.T @ values
    best, least = np.zeros(count), 0.0
    for size in range(1, count + 1):
        for chosen in map(list, combinations(range(count), size)):
            part = np.linalg.lstsq(gram[np.ix_(chosen, chosen)], right[chosen], rcond=None)[0]
            # Less the square of the values, which all choices share.
            square = float(part @ gram[np.ix_(chosen, chosen)] @ part - 2.0 * part @ right[chosen])
            if square < least and np.all(part >= 0.0):
                best, least = np.zeros(count), square
                best[chosen] = part
    return best


def _gathered(frames: int) -> FloatArray:
    """Return the matrix that sums features of all frames for what frames share."""
    alone = len(PER_FRAME) * frames
    matrix = np.zeros((alone + len(SHARED), alone + len(SHARED) * frames))
    matrix[:alone, :alone] = np.eye(alone)
    for index in range(len(SHARED)):
        matrix[alone + index, alone + index * frames : alone + (index + 1) * frames] = 1.0
    return matrix


def _tiled(images: FloatArray, side: int) -> tuple[FloatArray, tuple[int, int]]:
    """Return images (P, R, C) cut into tiles (T, P, side^2), filled up with nothing at the far edges."""
    rows, columns = images.shape[1:]
    padded = np.pad(images, ((0, 0), (0, -rows % side), (0, -columns % side)))
    down, across = padded.shape[1] // side, padded.shape[2] // side
    cut = padded.reshape(len(images), down, side, across, side).transpose(1, 3, 0, 2, 4)
    return np.ascontiguousarray(cut).reshape(down * across, len(images), side * side), (down, across)
