"""Statistics by NumPy, SciPy and statsmodels, the reference for `crates/evaluation/tests/statistics.rs`.

Programs: numpy 2.4.6, scipy 1.17.1 (BSD-3), statsmodels 0.15.0 (BSD-3), Python 3.11 or later.
    python -m venv venv && venv/bin/pip install numpy==2.4.6 scipy==1.17.1 statsmodels==0.15.0
    venv/bin/python statistics_reference.py
Writes statistics_reference.json beside itself. Seed 20240612.
"""

import json
import warnings
from pathlib import Path

import numpy as np
import scipy
import statsmodels
from scipy import stats
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.stats.multitest import multipletests

HERE = Path(__file__).resolve().parent
SEED = 20240612


def quantile_cases(rng):
    cases = []
    for size in [1, 2, 3, 10, 101, 1000]:
        values = np.round(rng.lognormal(mean=0.0, sigma=1.0, size=size), 6)
        probabilities = [0.0, 0.01, 0.25, 0.5, 0.9, 0.95, 0.999, 1.0]
        cases.append(
            {
                "values": values.tolist(),
                "probabilities": probabilities,
                "quantiles": np.quantile(values, probabilities).tolist(),
                "mean": float(np.mean(values)),
                "rmse": float(np.sqrt(np.mean(values**2))),
            }
        )
    return cases


def chi_square_cases():
    cases = []
    for dof in [1, 2, 3, 5, 6, 30, 600, 1000, 18000, 100000, 300000, 3000000]:
        for p in [0.005, 0.025, 0.05, 0.5, 0.9, 0.95, 0.975, 0.995]:
            x = stats.chi2.ppf(p, dof)
            cases.append({"dof": dof, "probability": p, "quantile": float(x), "tail": float(stats.chi2.sf(x, dof))})
    return cases


def wilcoxon_cases(rng):
    cases = []
    for size, shift, rounding in [(5, 0.5, 6), (8, 1.0, 6), (12, 0.0, 6), (20, 0.4, 6), (50, 0.3, 6), (51, 0.3, 6), (200, 0.1, 6)]:
        differences = np.round(rng.normal(loc=shift, size=size), rounding)
        cases.append(differences)
    for size, shift in [(20, 0.5), (60, 0.2), (30, 0.0)]:  # ties and zeros: one decimal
        cases.append(np.round(rng.normal(loc=shift, size=size), 1))
    result = []
    for differences in cases:
        magnitudes = np.abs(differences)
        used = magnitudes[magnitudes > 0]
        plain = used.size == differences.size and np.unique(used).size == used.size and used.size <= 50
        method = "exact" if plain else "asymptotic"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            test = stats.wilcoxon(differences, zero_method="wilcox", correction=False, method=method)
        ranks = stats.rankdata(used)
        plus = float(ranks[differences[magnitudes > 0] > 0].sum())
        minus = float(ranks.sum() - plus)
        result.append(
            {
                "differences": differences.tolist(),
                "method": method,
                "statistic": float(test.statistic),
                "p": float(test.pvalue),
                "rank_biserial": (plus - minus) / (plus + minus),
            }
        )
    return result


def bootstrap_cases(rng):
    cases = []
    samples = [rng.normal(2.0, 0.5, size=20), rng.lognormal(0.0, 1.0, size=40), rng.exponential(1.0, size=12)]
    for values in samples:
        values = np.round(values, 6)
        for confidence in [0.9, 0.95]:
            bootstrap = stats.bootstrap(
                (values,), np.mean, confidence_level=confidence, n_resamples=200_000, batch=10_000,
                method="BCa", rng=np.random.default_rng(SEED),
            )
            interval = bootstrap.confidence_interval
            cases.append(
                {
                    "values": values.tolist(),
                    "confidence": confidence,
                    "mean": float(np.mean(values)),
                    "lower": float(interval.low),
                    "upper": float(interval.high),
                    "standard_error": float(bootstrap.standard_error),
                }
            )
    return cases


def ljung_box_cases(rng):
    cases = []
    for size, memory in [(200, 0.0), (200, 0.2), (1000, 0.05), (50, 0.6)]:
        noise = rng.normal(size=size)
        series = np.zeros(size)
        for k in range(size):
            series[k] = noise[k] + (memory * series[k - 1] if k else 0.0)
        series = np.round(series + 0.3, 6)
        for lags in [1, 10, 20]:
            row = acorr_ljungbox(series, lags=[lags])
            cases.append(
                {
                    "series": series.tolist(),
                    "lags": lags,
                    "statistic": float(row["lb_stat"].iloc[0]),
                    "p": float(row["lb_pvalue"].iloc[0]),
                }
            )
    return cases


def holm_cases():
    cases = []
    for p in [[0.01, 0.04, 0.03, 0.005], [0.5], [0.02, 0.02, 0.02], [0.9, 0.8, 0.001, 0.04, 0.04, 0.3]]:
        cases.append({"p": p, "adjusted": multipletests(p, method="holm")[1].tolist()})
    return cases


def wilson_cases():
    cases = []
    for inside, total in [(0, 10), (5, 10), (95, 100), (181, 200), (200, 200)]:
        interval = stats.binomtest(inside, total).proportion_ci(confidence_level=0.95, method="wilson")
        cases.append({"inside": inside, "total": total, "lower": float(interval.low), "upper": float(interval.high)})
    return cases


def main():
    rng = np.random.default_rng(SEED)
    result = {
        "program": f"numpy {np.__version__}, scipy {scipy.__version__}, statsmodels {statsmodels.__version__}",
        "script": "statistics_reference.py",
        "seed": SEED,
        "quantiles": quantile_cases(rng),
        "chi_square": chi_square_cases(),
        "wilcoxon": wilcoxon_cases(rng),
        "bootstrap_bca": bootstrap_cases(rng),
        "ljung_box": ljung_box_cases(rng),
        "holm": holm_cases(),
        "wilson": wilson_cases(),
    }
    (HERE / "statistics_reference.json").write_text(json.dumps(result) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
