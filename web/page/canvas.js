// Sharp canvases: drawing in CSS pixels on whatever the screen has.

export const FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

/** Clears a canvas and calls `draw(context, width, height)` with its size in CSS pixels. */
export function paint(canvas, draw) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (w === 0 || h === 0) return;
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.lineJoin = "round";
  draw(context, width, height);
}

const grouping = new Intl.NumberFormat("en");

/** A whole number with its thousands apart. */
export const grouped = (number) => grouping.format(number);

/** Writes a text; `style` may have size, align, baseline, colour and weight. */
export function write(context, words, x, y, { size = 12, align = "left", baseline = "middle", colour, weight = "" } = {}) {
  Object.assign(context, { font: `${weight} ${size}px ${FONT}`, textAlign: align, textBaseline: baseline });
  if (colour) context.fillStyle = colour;
  context.fillText(words, x, y);
}
