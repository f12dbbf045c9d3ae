"""Slow twins of the virtual cell's kernels, and small cells to try them on."""

import numpy as np

from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.optics import MIXES, RING_RADIUS_MM, RING_Z_MM, ring_field

MASK = (1 << 64) - 1
QUIET = {
    "bandwidth_hz": 0.0,
    "refractory_us": 0.0,
    "background_hz": 0.0,
    "hot_share": 0.0,
    "latency_us": 0.0,
    "jitter_us": 0.0,
    "readout_us": 0.0,
    "threshold_spread": 0.0,
}


def small(name="three_lines", /, width=80, height=48, **groups):
    """Settings of a cell with a small image and plate; each group's entries go over these."""
    values = {
        "scene": {"name": name, "margin_mm": 1.5, "width_mm": 6.0},
        "camera": {"width": width, "height": height},
        "motion": {"hold_s": 0.01, "speed": 0.3, "acceleration": 60.0},
    }
    for group, entries in groups.items():
        if isinstance(entries, dict):
            values.setdefault(group, {}).update(entries)
        else:
            values[group] = entries
    return VirtualCellSettings.create(values)


def sample(values, origin, x, y):
    """Bilinear look-up in maps (ny, nx, 4) at x, y in mm -> (..., 4)."""
    ny, nx, _ = values.shape
    px = np.clip((x - origin[0]) / origin[2], 0, nx - 1.01)
    py = np.clip((y - origin[1]) / origin[2], 0, ny - 1.01)
    ix, iy = px.astype(int), py.astype(int)
    fx, fy = (px - ix)[..., None], (py - iy)[..., None]
    low = values[iy, ix] * (1 - fx) + values[iy, ix + 1] * fx
    high = values[iy + 1, ix] * (1 - fx) + values[iy + 1, ix + 1] * fx
    return low * (1 - fy) + high * fy


def trace(xn, yn, values, camera, roller, origin):
    """Twin of `_trace_row` in float64, by bisection along each ray: z, slopes, log reflectance."""
    radius, half, k, _ = roller

    def surface(z):
        x, y = xn * z, yn * z
        m = sample(values, origin, camera[0] + x, camera[1] - y)
        face = camera[2] - m[..., 0]
        free = np.sqrt(radius**2 - x**2)
        part = np.clip(0.5 + 0.5 * (free - face) / k, 0, 1)
        return part * face + (1 - part) * free - k * part * (1 - part), part, m, x, y, free

    low, high = np.full(xn.shape, 30.0), np.full(xn.shape, 50.0)
    for _ in range(40):
        middle = (low + high) / 2
        above = middle < surface(middle)[0]
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    z = (low + high) / 2
    _, part, m, x, y, free = surface(z)
    sx = part * -m[..., 1] - (1 - part) * x / free
    sy = part * m[..., 2]
    turned = radius * (np.arcsin(np.abs(x) / radius) - np.arcsin(half / radius))
    extra = np.where(np.abs(x) > half, np.sign(x) * (turned - (np.abs(x) - half)), 0.0)
    coat = sample(values, origin, camera[0] + x + (1 - part) * extra, camera[1] - y)[..., 3]
    return z, sx, sy, coat


def shade(xn, yn, z, sx, sy, coat, light):
    """Twin of `_shade_row`: LEDs summed one by one, for the matt part and for the lobe."""
    mix = MIXES[light.kind]
    x, y = xn * z, yn * z
    gx, gy, gz = ring_field(x, y, z)
    scale = -ring_field(np.zeros(1), np.zeros(1), np.full(1, 45.0))[2][0]
    matt = (sx * gx + sy * gy - gz) / np.sqrt(1 + sx**2 + sy**2) / scale
    alpha = RING_RADIUS_MM / (2 * (45.0 - RING_Z_MM / 2))
    facing = 1 / (z - RING_Z_MM / 2)
    ex, ey = sx + x * facing, sy + y * facing
    angles = np.arange(60) * np.pi / 30

    def lobe(a, b):
        parts = [
            (1 + ((a - alpha * np.cos(t)) ** 2 + (b - alpha * np.sin(t)) ** 2)
             / mix.lobe_slope**2) ** -2.0
            for t in angles
        ]  # fmt: skip
        return np.mean(parts, axis=0)

    gloss = lobe(ex, ey) / lobe(np.zeros(1), np.zeros(1))
    scattered = mix.ambient * (1 + 1 / np.sqrt(1 + sx**2 + sy**2)) / 2
    total = scattered + mix.diffuse * np.maximum(matt, 0) + mix.specular * gloss
    return np.log(total) + coat


def uniform(seed, pixel, draw):
    """Twin of `_uniform`."""
    h = (int(seed) + pixel * 0x9E3779B97F4A7C15) & MASK
    h ^= (draw * 0xD1B54A32D192ED03) & MASK
    h = ((h ^ (h >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    h = ((h ^ (h >> 27)) * 0x94D049BB133111EB) & MASK
    h ^= h >> 31
    return ((h >> 11) + 0.5) / 2**53


class PixelTwin:
    """One pixel of the sensor, in plain Python."""

    def __init__(self, pixel, on, off, rate, level, signal, noise, timing, seed):
        self.pixel, self.on, self.off, self.rate = pixel, on, off, rate
        self.level, self.signal, self.noise = np.float32(level), np.float32(signal), int(noise)
        self.before = np.float32(0)
        self.held, self.draws = 0, 0
        self.latency, self.jitter, self.refractory, self.readout, self.on_share = timing
        self.seed = seed

    def draw(self):
        self.draws += 1
        return uniform(self.seed, self.pixel, self.draws)

    def wait(self, t):
        return t + int(min(-np.log(self.draw()) / self.rate * 1e9, 1e18)) + 1

    def step(self, t0, t1, tau, new):
        """Events (time read out, polarity) between two frames."""
        l0 = self.signal
        a = (t1 - t0) / tau
        keep = np.float32(np.exp(-a))
        of_old = np.float32((1 - np.exp(-a)) / a - np.exp(-a))
        of_new = np.float32(1) - keep - of_old
        l1 = of_new * np.float32(new) + of_old * self.before + keep * l0
        self.before = np.float32(new)
        self.signal = l1
        slope = (float(l1) - float(l0)) / float(t1 - t0)
        events, t = [], t0
        while len(events) < 4:
            if self.held > 0:
                if self.held >= t1:
                    break
                t, self.held = max(t, self.held), 0
                self.level = np.float32(float(l0) + slope * float(t - t0))
                if self.noise < t:
                    self.noise = self.wait(t)
            rises = slope > 0 and l1 - self.level >= self.on
            falls = slope < 0 and self.level - l1 >= self.off
            crossing = None
            if rises or falls:
                target = self.level + self.on if rises else self.level - self.off
                crossing = t0 + int((float(target) - float(l0)) / slope)
                crossing = min(max(crossing, t), t1)
            if self.noise < t1 and (crossing is None or self.noise < crossing):
                at = max(self.noise, t)
                polarity = 1 if self.draw() < self.on_share else 0
                self.noise = self.wait(at)
                self.level = np.float32(float(l0) + slope * float(at - t0))
            elif crossing is not None:
                at, polarity = crossing, int(rises)
                self.level = np.float32(target)
            else:
                break
            seen = at + self.latency
            if self.jitter > 0:
                u, w = self.draw(), self.draw()
                normal = np.sqrt(-2 * np.log(u)) * np.cos(2 * np.pi * w)
                seen = max(seen + int(normal * self.jitter), at)
            if self.readout > 0:
                seen = (seen // self.readout + 1) * self.readout
                self.held = max(at + self.refractory, seen)
            elif self.refractory > 0:
                self.held = at + self.refractory
            t = at
            events.append((seen, polarity))
        return events
