#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of Kernel::band_limited, ::band_limited_wide and ::drooping come from (lib/filter.h); needs numpy.

A wave exp(iwx) that is sampled at whole x and read at fraction f through taps with weights c_j(f), after a prefilter
1/D(w), becomes sum_j c_j(f) exp(iwj) / D(w); the truth is exp(iwf).  c_j are polynomials in f, symmetric, adding up to 1
for every f; D(w) = 1 + d1 (cos w - 1) + d2 (cos 2w - 1).  Multiplied by D the difference is linear in all unknowns, so
they are found together by least squares, again and again with weights 1/D of the round before (Sanathanan & Koerner
1963) and with more weight on frequencies that exceed their goal (Lawson 1961).

The drooping kernel has no prefilter and need not return a wave at its full height, but M(w) times it, and the same at
every fraction: sum_j c_j(f) exp(iwj) = M(w) exp(iwf).  What differs between fractions are the wave's images, which
nothing mends later; M is known, and the weights of samples that are read with it divide by it.  The unknown M(w) are
linear as well; low frequencies hold M(w) = 1.
"""
import numpy as np

POLES, DEGREE = 2, 6
# The error that is wanted, in dB, over the frequency as a share of Nyquist's: low frequencies matter most in pictures.
SHARES = [0, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0]
GOALS = {5: [-108, -104, -100, -86, -72, -50, -27, -6], 7: [-125, -122, -120, -110, -92, -62, -34, -6]}


def design(taps, frequencies=160, fractions=41, rounds=120, reweighted=60):
    w = np.linspace(0.004, 1, frequencies) * np.pi
    f = (np.arange(fractions) + 0.5) / fractions - 0.5
    W, F = np.meshgrid(w, f, indexing="ij")
    goal = 10 ** (np.interp(w / np.pi, SHARES, GOALS[taps]) / 20)
    truth = np.exp(1j * W * F)
    columns, sums = [], []  # of the unknowns: what they add to the wave, and to the sum of the weights at f
    for p in range(0, DEGREE + 1, 2):  # the middle tap: even powers
        columns.append(F**p + 0j)
        sums.append(lambda x, p=p: x**p)
    for j in range(1, taps // 2 + 1):  # tap j at f, tap -j at -f
        for p in range(DEGREE + 1):
            columns.append(F**p * np.exp(1j * W * j) + (-F) ** p * np.exp(-1j * W * j))
            sums.append(lambda x, p=p: x**p + (-x) ** p)
    weights = len(columns)
    columns += [-truth * (np.cos(m * W) - 1) for m in range(1, POLES + 1)]
    A = np.stack(columns, -1)
    # Solutions whose weights add up to 1: a particular one and the null space.
    constraint = np.array([[s(x) for s in sums] + [0] * POLES for x in np.linspace(f[0], f[-1], 3 * DEGREE)])
    _, singular, vt = np.linalg.svd(constraint)
    null = vt[(singular > 1e-9 * singular[0]).sum():].T
    particular = np.linalg.lstsq(constraint, np.ones(len(constraint)), rcond=None)[0]
    D, importance, best = np.ones_like(W), np.ones_like(w), (np.inf, None, None)
    for k in range(rounds):
        scale = (importance / goal)[:, None] / D
        rows = (A * scale[..., None]).reshape(-1, A.shape[-1])
        right = (truth * scale).reshape(-1)
        rows, right = np.concatenate([rows.real, rows.imag]), np.concatenate([right.real, right.imag])
        x = particular + null @ np.linalg.lstsq(rows @ null, right - rows @ particular, rcond=1e-13)[0]
        D = 1 + sum(d * (np.cos(m * W) - 1) for m, d in enumerate(x[weights:], 1))
        error = np.sqrt((np.abs((A @ x - truth) / D) ** 2).mean(1))
        D = np.maximum(D, 0.003)
        excess = error / goal
        if k < reweighted:
            importance = np.clip(importance * (excess / excess.mean()) ** 0.35, 1e-4, 1e4)
        if excess.max() < best[0]:
            best = (excess.max(), x, error)
    return w, best[1][:weights], best[1][weights:], best[2]


FLAT, TOP = 0.2, 0.8  # of the drooping kernel: M = 1 up to there, and images are suppressed up to here


def basis(f, w):
    """[w, f, unknown]: what each coefficient adds to the wave; [f, unknown]: and to the sum of the weights."""
    W, F = np.meshgrid(w, f, indexing="ij")
    waves = [F**p + 0j for p in range(0, DEGREE + 1, 2)]
    sums = [f**p for p in range(0, DEGREE + 1, 2)]
    for j in (1, 2):
        for p in range(DEGREE + 1):
            waves.append(F**p * np.exp(1j * W * j) + (-F) ** p * np.exp(-1j * W * j))
            sums.append(f**p + (-f) ** p)
    return np.stack(waves, -1), np.stack(sums, -1)


def design_drooping(frequencies=60, fractions=40):
    w = np.linspace(0.02, TOP, frequencies) * np.pi
    f = (np.arange(fractions) + 0.5) / fractions - 0.5
    waves, sums = basis(f, w)
    waves = waves * np.exp(-1j * np.outer(w, f))[..., None]
    unknowns = waves.shape[-1]
    flat = FLAT * np.pi
    rows, right = [], []
    for i, frequency in enumerate(w):
        # Rings of the plane's frequencies grow with w; low ones count for more.
        importance = frequency * (100 * flat / frequency if frequency <= flat else 1)
        block = np.zeros((2 * fractions, unknowns + frequencies))
        block[:fractions, :unknowns], block[fractions:, :unknowns] = waves[i].real, waves[i].imag
        block[:fractions, unknowns + i] = -1
        height = np.zeros((1, unknowns + frequencies))
        height[0, unknowns + i] = 3e4 if frequency <= flat else 0.3
        rows += [importance * block, height]
        right += [np.zeros(2 * fractions), height[0, unknowns + i : unknowns + i + 1]]
    unity = np.hstack([sums, np.zeros((fractions, frequencies))])
    rows.append(1e5 * unity)
    right.append(1e5 * np.ones(fractions))
    x = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-13)[0][:unknowns]
    heights = waves @ x
    return w, x, heights.mean(1).real, heights.std(1)


def poles(d):
    polynomial = np.zeros(2 * len(d) + 1)
    polynomial[len(d)] = 1 - sum(d)
    for m, value in enumerate(d, 1):
        polynomial[len(d) + m] += value / 2
        polynomial[len(d) - m] += value / 2
    roots = np.roots(polynomial)
    return roots[np.abs(roots) < 1]


def print_weights(c):
    first = DEGREE // 2 + 1
    print("c0", c[:first])
    for j, at in enumerate(range(first, len(c), DEGREE + 1), 1):
        print(f"c{j}", c[at : at + DEGREE + 1])


if __name__ == "__main__":
    np.set_printoptions(precision=10, linewidth=120)
    for taps, name in ((5, "band_limited"), (7, "band_limited_wide")):
        w, c, d, error = design(taps)
        print(name)
        print_weights(c)
        print("poles", poles(d))
        for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9):
            decibels = 20 * np.log10(np.interp(share * np.pi, w, error))
            print(f"error at {share:.1f} of Nyquist's frequency: {decibels:.1f} dB")

    w, c, height, images = design_drooping()
    print("drooping")
    print_weights(c)
    for share in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8):
        at = share * np.pi
        print(f"at {share:.2f}: M {np.interp(at, w, height):.5f}, images {20 * np.log10(np.interp(at, w, images)):.1f} dB")
