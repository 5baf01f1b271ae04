// Mean ages over slots, and the use of the sub-channels slot by slot.

import { grouped, paint, write } from "./canvas.js";
import { DASHES, USES, kindOfUse, colour, policyColour, share } from "./colours.js";

const SHOWN_SLOTS = 2000, SMOOTHED_SLOTS = 25;
const AGE_TICKS = [1, 2, 5, 10, 20, 50, 100];

/** Slots whose mean decides the order of names that would touch: they do not change places from frame to frame. */
const ORDERED_SLOTS = 500;

/** `lines` are policies with their history, the one in charge first; `marks` are changes by hand: { slot, words }. */
export function drawAges(canvas, cell, lines, marks) {
  const elapsed = cell.elapsed, first = Math.max(0, elapsed - SHOWN_SLOTS);
  paint(canvas, (context, width, height) => {
    const plot = { left: 48, right: width - 96, top: 8, bottom: height - 34 };
    const x = (slot) => plot.left + ((slot - first) / SHOWN_SLOTS) * (plot.right - plot.left);
    const y = (age) => plot.bottom - share(age) * (plot.bottom - plot.top);
    drawAxes(context, plot, x, y, first);
    drawMarks(context, plot, x, marks.filter(({ slot }) => slot > first));
    const labels = [];
    const bound = cell.bound;
    line(context, [[plot.left, y(bound)], [x(elapsed), y(bound)]], colour("ink"), [1, 2], 1);
    labels.push({ y: y(bound), order: bound, words: "bound", colour: colour("ink") });
    // The policy in charge comes last, on top of the others.
    for (const [index, { policy, history }] of [...lines.entries()].reverse()) {
      const points = smoothed(history, first, elapsed, (plot.right - plot.left) / SHOWN_SLOTS);
      if (points.length === 0) continue;
      const chosen = index === 0, tone = colour(policyColour(policy));
      line(context, points.map(([slot, age]) => [x(slot), y(age)]), tone, chosen ? [] : DASHES[policy], chosen ? 2.5 : 1.5);
      const recent = mean(history, Math.max(0, elapsed - ORDERED_SLOTS), elapsed);
      labels.push({ y: y(points.at(-1)[1]), order: recent, words: policy, colour: tone, weight: chosen ? 600 : "" });
    }
    drawLabels(context, labels, Math.min(x(elapsed), plot.right) + 7, plot);
  });
}

/** Means of the last slots before each point; a point for every second pixel or so. */
function smoothed(history, first, elapsed, pixelsPerSlot) {
  const points = [], stride = Math.max(1, Math.round(2 / pixelsPerSlot));
  for (let end = Math.ceil((first + 1) / stride) * stride; end <= elapsed; end += stride) {
    const start = Math.max(0, end - SMOOTHED_SLOTS);
    points.push([end, mean(history, start, end)]);
  }
  return points;
}

/** Mean age over slots from `start` to before `end`. */
export function mean(history, start, end) {
  let sum = 0;
  for (let slot = start; slot < end; slot += 1) sum += history(slot);
  return sum / (end - start);
}

function drawAxes(context, plot, x, y, first) {
  for (const age of AGE_TICKS) {
    line(context, [[plot.left, y(age)], [plot.right, y(age)]], colour("line"), [], 1);
    const words = age === AGE_TICKS.at(-1) ? `${age} ms` : String(age);
    write(context, words, plot.left - 6, y(age), { size: 11, align: "right", colour: colour("quiet") });
  }
  for (let slot = Math.ceil(first / 500) * 500; slot <= first + SHOWN_SLOTS; slot += 500) {
    write(context, grouped(slot), x(slot), plot.bottom + 12, { size: 11, align: "center", colour: colour("quiet") });
  }
  const middle = (plot.left + plot.right) / 2;
  write(context, "slot (ms)", middle, plot.bottom + 27, { size: 11, align: "center", colour: colour("quiet") });
}

function drawMarks(context, plot, x, marks) {
  let row = 0;
  for (const { slot, words } of marks) {
    line(context, [[x(slot), plot.top], [x(slot), plot.bottom]], colour("quiet"), [4, 3], 1);
    const align = x(slot) > (plot.left + plot.right) / 2 ? "right" : "left";
    write(context, words, x(slot) + (align === "left" ? 5 : -5), plot.top + 8 + 14 * (row % 3), { size: 11, align, colour: colour("quiet") });
    row += 1;
  }
}

/** Names at the ends of their lines, pushed apart where they would touch. */
function drawLabels(context, labels, x, plot) {
  labels.sort((a, b) => b.order - a.order);
  const gap = 13;
  labels.forEach((label, i) => { if (i > 0) label.y = Math.max(label.y, labels[i - 1].y + gap); });
  for (let i = labels.length - 1, most = plot.bottom + 4; i >= 0; i -= 1, most -= gap) labels[i].y = Math.min(labels[i].y, most);
  for (const { words, y, colour, weight } of labels) write(context, words, x, y, { size: 12, colour, weight });
}

function line(context, points, colour, dash, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  points.forEach((point, index) => (index === 0 ? context.moveTo(...point) : context.lineTo(...point)));
  context.stroke();
  context.setLineDash([]);
}

const SLOT_WIDTH = 15, ROW_GAP = 4;

export function drawOccupancy(canvas, cell) {
  const elapsed = cell.elapsed, use = cell.occupancy(), ring = cell.usesRing;
  const subChannels = cell.about.scenario.radio.sub_channels;
  paint(canvas, (context, width, height) => {
    const left = 96, row = height / subChannels;
    const shown = Math.min(Math.floor((width - left) / SLOT_WIDTH), cell.about.layout.occupancy_slots);
    for (let n = 0; n < subChannels; n += 1) {
      const floor = (n + 1) * row - ROW_GAP;
      write(context, `sub-channel ${n + 1}`, 0, floor - row / 2 + ROW_GAP / 2, { size: 12, colour: colour("quiet") });
      context.fillStyle = colour("line");
      context.fillRect(left, floor, shown * SLOT_WIDTH, 1);
      for (let back = 1; back <= Math.min(shown, elapsed); back += 1) {
        const slot = use(elapsed - back, n), kind = kindOfUse(slot), x = left + (shown - back) * SLOT_WIDTH;
        if (slot.open && ring) {
          context.fillStyle = colour("open");
          context.fillRect(x, floor - (row - ROW_GAP), SLOT_WIDTH - 1, row - ROW_GAP);
        }
        if (kind === null) continue;
        const tall = (row - ROW_GAP) * USES[kind].height;
        context.fillStyle = colour(kind);
        context.fillRect(x, floor - tall, SLOT_WIDTH - 1, tall);
        if (slot.received !== null) {
          const words = { size: 9.5, align: "center", colour: colour("panel") };
          write(context, String(slot.received), x + (SLOT_WIDTH - 1) / 2, floor - tall / 2 + 0.5, words);
        }
      }
    }
  });
}
