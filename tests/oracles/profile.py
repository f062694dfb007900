"""Profile likelihood intervals by another program: MINOS of iminuit, and by refits with scipy.

    pip install iminuit==2.33.0 scipy && python tests/oracles/profile.py > tests/oracles/profile.json

The model is y = a exp(-b t) with ten values that deviate by a known pattern, weighed by a known standard deviation that is
so large that the intervals are not symmetric.
"""

import json

import numpy as np
from iminuit import Minuit
from scipy.optimize import minimize_scalar

k = np.arange(10)
time = 0.5 * k
values = 3.0 * np.exp(-0.3 * time) + 0.15 * np.sin(7.0 * k)
std = 0.8


def cost(a: float, b: float) -> float:
    return float(np.sum(((values - a * np.exp(-b * time)) / std) ** 2))


fit = Minuit(cost, a=2.5, b=0.4)
fit.errordef, fit.tol, fit.strategy = 1.0, 1e-6, 2
fit.migrad()
result = {"time": time.tolist(), "values": values.tolist(), "std": std, "estimate": list(fit.values), "intervals": {}}
for level in (0.95, 0.997):
    fit.minos(cl=level)
    assert all(error.is_valid for error in fit.merrors.values())
    ends = [[fit.values[i] + fit.merrors[i].lower, fit.values[i] + fit.merrors[i].upper] for i in (0, 1)]
    result["intervals"][str(level)] = ends
held = [0.05, 0.2, 0.4, 0.6]
best = [minimize_scalar(lambda a, b=b: cost(a, b), bracket=(1.0, 4.0), tol=1e-12).fun - fit.fval for b in held]
result["held"], result["statistic"] = held, best
print(json.dumps(result, indent=1))
