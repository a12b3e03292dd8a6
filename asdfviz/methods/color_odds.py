"""The compiled loops behind `divided_so`: how much likelier colours are on a part than on what is behind it."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel


@kernel
@no_type_check
def _gathered(colors, mask):
    """Colours of the pixels of a mask."""
    rows, columns = mask.nonzero()
    found = np.empty((len(rows), 3))
    for i in range(len(rows)):
        for k in range(3):
            found[i, k] = colors[rows[i], columns[i], k]
    return found


@kernel
@no_type_check
def _normal(samples, each, together):
    """Median of samples (n 3), inverse and logarithm of the determinant of their covariance, to which
    `each` squared is added for every colour and `together` squared / 3 for all at once."""
    middle, mean, S = np.empty(3), np.zeros(3), np.empty((3, 3))
    for k in range(3):
        middle[k] = np.median(samples[:, k])
        mean[k] = samples[:, k].mean()
    for a in range(3):
        for b in range(3):
            total = 0.0
            for i in range(len(samples)):
                total += (samples[i, a] - mean[a]) * (samples[i, b] - mean[b])
            S[a, b] = total / (len(samples) - 1) + together**2 / 3 + (each**2 if a == b else 0.0)
    inverse = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            c, d, e, f = (b + 1) % 3, (b + 2) % 3, (a + 1) % 3, (a + 2) % 3
            inverse[a, b] = S[c, e] * S[d, f] - S[c, f] * S[d, e]
    determinant = S[0, 0] * inverse[0, 0] + S[0, 1] * inverse[1, 0] + S[0, 2] * inverse[2, 0]
    return middle, inverse / determinant, np.log(determinant)


@kernel
@no_type_check
def _likelihood(color, middle, inverse, log_determinant):
    """Logarithm of a normal density, but for a constant."""
    total = log_determinant
    for a in range(3):
        for b in range(3):
            total += (color[a] - middle[a]) * inverse[a, b] * (color[b] - middle[b])
    return -0.5 * total


@kernel
@no_type_check
def mean_odds(colors, drawn, asked, common, around, each, together, surest):
    """Mean log-odds with which asked pixels show the part where each pose has it, and not elsewhere.

    Args:
        colors: h w 3, logarithms.
        drawn: n h w, where each pose has the part.
        asked: h w, pixels that count.
        common: h w, what shows the part.
        around: h w, what shows what is behind it.
        each: least deviation of a colour's logarithm.
        together: of brightness alone.
        surest: no pixel counts for more than these log-odds.
    """
    part, behind = _gathered(colors, common), _gathered(colors, around)
    middle, inverse, log_determinant = _normal(part, each, together)
    middle_b, inverse_b, log_determinant_b = _normal(behind, each, together)
    found, count = np.zeros(len(drawn)), 0
    for row in range(asked.shape[0]):
        for column in range(asked.shape[1]):
            if not asked[row, column]:
                continue
            count += 1
            color = colors[row, column]
            odds = _likelihood(color, middle, inverse, log_determinant)
            odds -= _likelihood(color, middle_b, inverse_b, log_determinant_b)
            odds = min(max(odds, -surest), surest)
            for k in range(len(drawn)):
                found[k] += odds if drawn[k, row, column] else -odds
    return found / max(count, 1)
