"""What a project file says of values with a status, and of the instruments that groups of observations share."""

from __future__ import annotations

from pydantic import Field, model_validator

from mor.project.file.scalars import Measure, Strict


class Value(Strict):
    """A component with its status: exactly one of free, fixed, observed."""

    free: Measure | None = Field(default=None, description="Unknown, starting at this value")
    fixed: Measure | None = Field(default=None, description="Constant")
    observed: Measure | None = Field(default=None, description="Unknown, observed with sigma")
    sigma: Measure | None = Field(default=None, description="σ of an observed value; 0 means fixed")
    start: Measure | None = Field(
        default=None, description="Start value, where it differs from the observed one"
    )

    @model_validator(mode="after")
    def _one_status(self) -> Value:
        given = [key for key in ("free", "fixed", "observed") if getattr(self, key) is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of free, fixed, observed")
        if (self.observed is not None) != (self.sigma is not None):
            raise ValueError("sigma belongs to an observed value, and an observed value needs one")
        return self


Setting = Measure | Value
"""A plain number (with the status its section says) or a value with its status."""


class Atmosphere(Strict):
    """What an instrument takes the velocity of light to be: the first velocity correction from columns of the air."""

    C: float = Field(description="Reference refractivity (n - 1) · 10⁶ of the instrument")
    D: float | None = Field(default=None, description="Constant of its carrier wavelength, K/hPa · 10⁶")
    wavelength: Measure | None = Field(
        default=None, description="Its carrier wavelength in place of D: 0.658 um"
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> Atmosphere:
        if (self.D is None) == (self.wavelength is None):
            raise ValueError("give either D or wavelength")
        return self


class Instrument(Strict):
    """Parameters that a group of distances or vertical angles shares; a plain number is fixed."""

    scale: Setting | None = Field(default=None, description="Distance scale m, s_obs = (s - a)/m")
    offset: Setting | None = Field(default=None, description="Zero offset a")
    refraction: Setting | None = Field(default=None, description="Refraction coefficient k")
    atmosphere: Atmosphere | None = Field(
        default=None,
        description="C, and D or wavelength: distances with columns temperature (°C), pressure (hPa), humidity (%) or "
        "vapour_pressure (hPa) get their first velocity correction",
    )
    frame: dict[str, Setting] = Field(
        default_factory=dict,
        description="shift_x, shift_y, shift_z, turn_x, turn_y, turn_z and scale of the frame of a GNSS solution "
        "against that of the points, geocentric axes, about the middle of the network",
    )
    lever_arm: dict[str, Setting] = Field(
        default_factory=dict, description="rx, ry, rz from the trajectory to the antenna, its own axes"
    )
    boresight: dict[str, Setting] = Field(
        default_factory=dict,
        description="omega, phi, kappa from the axes of the trajectory to those of an inertial system",
    )
    position: dict[str, Setting] = Field(
        default_factory=dict,
        description="shift_x, shift_y, shift_z, drift_x, drift_y, drift_z of positions, of each strip its own",
    )
    attitude: dict[str, Setting] = Field(
        default_factory=dict,
        description="turn_x, turn_y, turn_z, turn_drift_x, turn_drift_y, turn_drift_z of attitudes, of each strip "
        "its own",
    )
    time_offset: Setting | None = Field(
        default=None, description="What is to be added to the times of the instrument, e.g. 20 ms"
    )


class Centring(Strict):
    """Set-up errors of instrument and target, added to the σ of an observation as far as they act on it."""

    instrument: Measure = Field(default="0", description="σ of its horizontal position, in either coordinate")
    target: Measure = Field(default="0", description="The same of the target")
    instrument_height: Measure = Field(default="0", description="σ of the measured height of the instrument")
    target_height: Measure = Field(default="0", description="σ of the measured height of the target")
