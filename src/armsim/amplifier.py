r"""A Raman fibre amplifier, a typical application of the exponential form.

Along the fibre the power of each wave, pump or signal, obeys P' = P F(P):

.. math:: \frac{dP_i}{dz} = P_i \Bigl(-\alpha_i + \sum_j g_{ij} P_j\Bigr)

A wave gains power from those of higher frequency, :math:`g_{ij} > 0` for :math:`\nu_j > \nu_i`, and
loses it to those of lower frequency, photon for photon: :math:`g_{ij} \nu_j = -g_{ji} \nu_i`. All
waves travel in the same direction, so this is an initial-value problem. A pump from the far end
would make it a boundary-value problem, which shooting reduces to a sequence of initial-value
problems like this one. Noise and Rayleigh scattering are neglected.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.constants import c
from scipy.integrate import solve_ivp
from scipy.special import wofz

from armsim.checks import checked_count, checked_number
from armsim.machine_code import kept

#: Vibrational modes of silica, one per column: position, relative strength, and full widths at half
#: maximum of the Gaussian and the Lorentzian part; all but the strength in 1/cm. Hollenbeck and
#: Cantrell, J. Opt. Soc. Am. B 19 (2002) 2886, table 1.
_MODES = np.array(
    [
        [56.25, 100, 231.25, 362.5, 463, 497, 611.5, 691.67, 793.67, 835.5, 930, 1080, 1215],
        [1, 11.4, 36.67, 67.67, 74, 4.5, 6.8, 4.6, 4.2, 4.5, 2.7, 3.1, 3],
        [52.1, 110.42, 175, 162.5, 135.33, 24.5, 41.5, 155, 59.5, 64.3, 150, 91, 160],
        [17.37, 38.81, 58.33, 54.17, 45.11, 8.17, 13.83, 51.67, 19.83, 21.43, 50, 30.33, 53.33],
    ]
)


def _spectrum(shift: np.ndarray) -> np.ndarray:
    r"""Sine transform of :math:`\sum A e^{-\gamma t - (\Gamma t/2)^2} \sin\omega t`, unscaled."""
    position, strength, gauss, lorentz = _MODES
    to_width = 100 * np.pi * c  # from 1/cm, full width, to half of it in rad/s

    def part(detuning: np.ndarray) -> np.ndarray:
        return (wofz((detuning + 1j * lorentz * to_width) / (gauss * to_width)) / gauss).real

    omega = 2 * np.pi * np.asarray(shift)[..., None]
    centre = 2 * position * to_width
    return ((part(omega - centre) - part(omega + centre)) * strength).sum(axis=-1)


_PEAK = _spectrum(np.linspace(13e12, 13.4e12, 4001)).max()


def raman_spectrum(shift: float | np.ndarray) -> np.ndarray:
    """Raman gain of silica at a frequency shift in Hz, relative to its peak near 13 THz.

    The 13-mode model of Hollenbeck and Cantrell in closed form. An odd function of the shift.
    """
    return _spectrum(np.asarray(shift, dtype=float)) / _PEAK


@dataclass(frozen=True)
class RamanAmplifier:
    """Raman amplifier whose pumps and signals enter a single-mode fibre at the same end.

    The defaults are our choice, typical of a distributed amplifier for the C and L bands (Bromage,
    J. Lightwave Technol. 22 (2004) 79).

    Parameters
    ----------
    pump_wavelengths, pump_powers : tuple of float
        Wavelengths in m and powers in W.
    channels : int
        Number of signals, equally spaced in frequency over `band`.
    band : (float, float)
        Shortest and longest signal wavelength, m.
    channel_power : float
        Power of each signal at the input, W; 1 mW is 0 dBm.
    length : float
        Length of the fibre, m.
    effective_area : float
        Effective area of the mode, m²; 80 µm² is common in standard single-mode fibre.
    peak_gain : float
        Peak Raman gain for unpolarized light and a pump of 1450 nm, m/W. It is proportional to the
        pump frequency. Divided by the default area it is 0.4 /(W km).
    rayleigh, infrared : float
        Coefficients in dB m³ and dB/m of the loss rayleigh/λ⁴ + infrared exp(-48.48 µm/λ), which
        is 0.19 dB/km at 1550 nm by default.
    """

    pump_wavelengths: tuple[float, ...] = (1425e-9, 1436e-9, 1450e-9, 1466e-9, 1495e-9)
    pump_powers: tuple[float, ...] = (0.2, 0.2, 0.15, 0.1, 0.1)
    channels: int = 80
    band: tuple[float, float] = (1530e-9, 1610e-9)
    channel_power: float = 1e-3
    length: float = 50e3
    effective_area: float = 80e-12
    peak_gain: float = 3.2e-14
    rayleigh: float = 1.0e-27
    infrared: float = 7.8e8

    def __post_init__(self) -> None:
        if (pumps := len(self.pump_wavelengths)) != (powers := len(self.pump_powers)):
            found = f"{pumps} pump_wavelengths and {powers} pump_powers"
            raise ValueError(f"{found}: one power is needed for each pump")
        object.__setattr__(self, "channels", checked_count("channels", self.channels))
        for name in ("channel_power", "length", "effective_area", "peak_gain"):
            object.__setattr__(self, name, checked_number(name, getattr(self, name), above=0.0))

    @cached_property
    def frequency(self) -> np.ndarray:
        """Frequency of each wave in Hz, pumps first."""
        signals = np.linspace(c / self.band[0], c / self.band[1], self.channels)
        return np.concatenate([c / np.array(self.pump_wavelengths, float), signals])

    @cached_property
    def input_power(self) -> np.ndarray:
        """Input power of each wave in W."""
        return np.array([*self.pump_powers, *[self.channel_power] * self.channels], float)

    @cached_property
    def loss(self) -> np.ndarray:
        """Loss α of each wave in 1/m."""
        wavelength = c / self.frequency
        decibels = self.rayleigh / wavelength**4 + self.infrared * np.exp(-48.48e-6 / wavelength)
        return decibels * np.log(10) / 10

    @cached_property
    def gain(self) -> np.ndarray:
        """Gain in 1/(W m), whose entry [j, i] is the growth rate of wave i per watt of wave j."""
        source, wave = self.frequency[:, None], self.frequency[None, :]
        higher = np.maximum(source, wave) / (c / 1450e-9)
        photons = np.where(source < wave, wave / source, 1.0)
        gain = self.peak_gain / self.effective_area * raman_spectrum(source - wave)
        return gain * higher * photons

    @property
    def args(self) -> tuple[np.ndarray, np.ndarray]:
        """Arguments of `rhs` after z and P."""
        return self.loss, self.gain

    def scaled(self, factor: float) -> Self:
        """Return the amplifier with all powers multiplied by a factor."""
        pumps = tuple(factor * power for power in self.pump_powers)
        return replace(self, pump_powers=pumps, channel_power=factor * self.channel_power)

    @cached_property
    def _logarithms(self) -> Any:
        how: dict = {"args": self.args, "rtol": 1e-13, "atol": 1e-14, "dense_output": True}
        return solve_ivp(log_rhs, (0, self.length), np.log(self.input_power), "DOP853", **how).sol

    def solution(self, z: np.ndarray | float) -> np.ndarray:
        """Powers in W at the position z in m, to 12 digits: DOP853 for ln P."""
        return np.exp(self._logarithms(z))

    @cached_property
    def output_power(self) -> np.ndarray:
        """Power of each wave at the end of the fibre in W."""
        return self.solution(self.length)

    @property
    def on_off_gain(self) -> np.ndarray:
        """Gain of each signal in dB, its output power over that with loss alone."""
        lossy = self.input_power * np.exp(-self.loss * self.length)
        return 10 * np.log10(self.output_power / lossy)[len(self.pump_powers) :]

    def fastest_rates(self) -> tuple[float, ...]:
        """Largest eigenvalues, 1/m, of the Jacobians in P and in ln P at the end of the fibre.

        The Jacobians are diag(F) + diag(P) ∂F/∂P and, up to similarity, the second term alone.
        """
        coupling = self.output_power[:, None] * self.gain.T
        of_power = coupling + np.diag(growth_rate(self.output_power, *self.args))
        return tuple(float(np.abs(np.linalg.eigvals(J)).max()) for J in (of_power, coupling))


@kept()
def growth_rate(power: np.ndarray, loss: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """F, the relative growth of each power along the fibre, 1/m."""
    rate = -loss
    for j in range(power.size):
        for i in range(power.size):  # contiguous in memory, so the loop is vectorized
            rate[i] += gain[j, i] * power[j]
    return rate


@kept()
def rhs(z: float, power: np.ndarray, loss: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """dP/dz = P F(P), W/m, with the arguments of `scipy.integrate.solve_ivp`."""
    return power * growth_rate(power, loss, gain)


@kept()
def log_rhs(z: float, log_power: np.ndarray, loss: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """d(ln P)/dz = F(P), 1/m, with the arguments of `rhs`."""
    return growth_rate(np.exp(log_power), loss, gain)


@kept()
def average_power(
    power: np.ndarray,
    loss: np.ndarray,
    gain: np.ndarray,
    length: float,
    sections: int,
    evaluations: int,
) -> np.ndarray:
    r"""Powers at the end of the fibre by the average-power method.

    In a section of length h every power is multiplied by :math:`G_i = \exp(h F_i(\bar P))`. F is
    affine in the powers, so this is exact if :math:`\bar P` is their mean over the section. The
    method uses the mean of an exponential with the same ends, :math:`P_i (G_i - 1)/\ln G_i`. Since
    this needs G, F is first evaluated at the input powers of the section, then at the means from
    the previous evaluation. One evaluation is the exponential form of Euler's method; two or more
    are of second order.
    """
    h = length / sections
    power = power.copy()
    for _ in range(sections):
        exponent = h * growth_rate(power, loss, gain)
        for _ in range(evaluations - 1):
            mean = power * np.where(exponent == 0, 1.0, np.expm1(exponent) / exponent)
            exponent = h * growth_rate(mean, loss, gain)
        power *= np.exp(exponent)
    return power
