// Orientations for people: rotations about the fixed axes x, then y, then z (R = Rz Ry Rx), rad.
export function turns([x, y, z, w]) {
  const sine = Math.max(-1, Math.min(1, 2 * (w * y - z * x)));
  if (Math.abs(sine) > 1 - 1e-9) return [2 * Math.atan2(x, w), (Math.sign(sine) * Math.PI) / 2, 0]; // x and z turn alike
  return [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), Math.asin(sine), Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))];
}

export function quaternion([x, y, z]) {
  const [[a, s], [b, t], [c, u]] = [x, y, z].map((v) => [Math.cos(v / 2), Math.sin(v / 2)]);
  return [s * b * c - a * t * u, a * t * c + s * b * u, a * b * u - s * t * c, a * b * c + s * t * u];
}
