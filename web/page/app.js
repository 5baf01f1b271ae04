// The page: controls in, pictures out. The simulation itself is in cell.js and the program behind it.

import { Cell, Refusal, load } from "./cell.js";
import { drawAges, drawOccupancy } from "./charts.js";
import { drawMap, drawScale, find } from "./map.js";
import { placeOf, setText, showCommand, showLegend, showSummaries, showVehicles } from "./tables.js";

const COMPARISONS = ["central", "age-threshold", "aloha"];
/** What decides where the network does not serve: the rules that it was distilled from. */
const STAND_IN = "clock";
const SLOTS_PER_FRAME = [1 / 30, 1 / 10, 1 / 4, 1, 2, 4, 8, 17, 40, 80];
/** Time of a frame that slots may take, so that the picture stays smooth on a slow machine. */
const SLOTS_MS = 18;
const TEXTS_EVERY_MS = 125;

const element = (id) => document.getElementById(id);
const stage = element("cell"), canvas = element("map");

const state = {
  module: null, cell: null, vehicles: [],
  policy: "actor", running: true, until: Infinity, selected: null,
  /** Changes by hand since the start, { slot, words }: the command line knows none. */
  changes: [],
  debt: 0, msPerSlot: 0.05, textsAt: 0, joined: 0,
};

const wishes = () => ({
  seed: element("seed").value,
  settings: [`cell.vehicles=${element("vehicles").value}`, `radio.min_spectral_efficiency=${element("c-min").value}`],
});

/** A new world as the controls say. Where it is refused, the one before goes on. */
function open() {
  const request = (policy) => ({ ...wishes(), policy, comparisons: COMPARISONS });
  let cell, note = "";
  try {
    try {
      cell = new Cell(state.module, request(state.policy));
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      cell = new Cell(state.module, request(STAND_IN));
      note = `The ${state.policy} does not serve this cell (${error.message}). The ${STAND_IN} decides instead.`;
    }
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    say(`Not possible: ${error.message}.`);
    return;
  }
  Object.assign(state, { cell, changes: [], selected: null, debt: 0, joined: 0 });
  const options = cell.about.policies.map(({ name, meaning, refused }) => {
    const option = new Option(refused ? `${name} (not at this C_min)` : name, name);
    option.disabled = Boolean(refused);
    option.title = meaning;
    return option;
  });
  element("policy").replaceChildren(...options);
  element("policy").value = cell.runs[0];
  element("vehicles").max = cell.about.room;
  say(note);
  remember();
  draw();
}

function setPolicy(name) {
  const before = state.cell.runs[0];
  try {
    state.cell.setPolicy(name);
    state.policy = name;
    if (name !== before) changed(`${before} → ${name}`);
    say("");
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    element("policy").value = before;
    say(`Not possible: ${error.message}.`);
  }
  remember();
}

/** Notes a change by hand, which ends what the command line could repeat. */
function changed(words) {
  state.changes.push({ slot: state.cell.elapsed, words });
  draw();
}

function jam(index) {
  const vehicle = state.vehicles[index];
  if (!vehicle || !state.cell.jam(index, !vehicle.jammed)) return;
  state.selected = index;
  changed(vehicle.jammed ? `${index} is free` : `${index} is jammed`);
}

function join(x, y) {
  if (state.cell.join(x, y)) {
    state.joined += 1;
    changed("one more vehicle");
    say("A vehicle joins; it is heard of within 100 slots.");
  } else {
    say(`No room: the page shows ${state.cell.about.room} vehicles at most.`);
  }
}

/** A place for a vehicle that joins without a click: spread evenly by the golden ratio. */
function joinSomewhere() {
  const { blocks_x, block_x_m, blocks_y, block_y_m } = state.cell.about.scenario.mobility;
  const golden = (share) => (state.joined + 1) * share % 1;
  join(golden(0.618034) * blocks_x * block_x_m, golden(0.414214) * blocks_y * block_y_m);
}

function run(running) {
  state.running = running;
  element("play").textContent = running ? "Pause" : "Run";
  if (running && state.cell.elapsed >= state.until) state.until = Infinity;
  showTexts();
}

function step() {
  run(false);
  state.cell.advance(1);
  draw();
}

/** Slots for this frame at the chosen speed, within its time. */
function slotsOfFrame() {
  state.debt += SLOTS_PER_FRAME[element("speed").value];
  const whole = Math.floor(state.debt);
  state.debt -= whole;
  return Math.min(whole, Math.max(1, Math.floor(SLOTS_MS / state.msPerSlot)), state.until - state.cell.elapsed);
}

function frame() {
  requestAnimationFrame(frame);
  if (!state.cell || !state.running) return;
  try {
    const begin = performance.now(), slots = slotsOfFrame();
    if (slots > 0) {
      state.cell.advance(slots);
      state.msPerSlot += 0.1 * ((performance.now() - begin) / slots - state.msPerSlot);
      drawPictures();
    }
    if (performance.now() - state.textsAt > TEXTS_EVERY_MS) showTexts();
    const { elapsed } = state.cell;
    if (elapsed >= state.until || elapsed >= state.cell.about.most_slots) run(false);
  } catch (error) {
    recover(error);
  }
}

/** A program that stopped leaves its instance unusable: say so and begin a new one. */
function recover(error) {
  console.error(error);
  run(false);
  try {
    open();
    say(`The simulation stopped (${error.message}). This is a new world with the same settings.`);
  } catch (again) {
    fail(again);
  }
}

function fail(error) {
  console.error(error);
  stage.dataset.state = "failed";
  say(`The cell cannot run here: ${error.message}.`);
}

function draw() {
  drawPictures();
  showTexts();
}

function drawPictures() {
  const { cell } = state;
  state.vehicles = cell.vehicles();
  drawMap(canvas, cell.about.scenario, state.vehicles, state.selected, cell.usesRing);
  drawAges(element("age-chart"), cell, state.changes);
  drawOccupancy(element("occupancy"), cell);
}

function showTexts() {
  const { cell } = state;
  state.textsAt = performance.now();
  stage.dataset.state = state.running ? "running" : "paused";
  stage.dataset.elapsed = cell.elapsed;
  showSummaries(cell);
  showCommand(cell, { ...wishes(), running: state.running, changes: state.changes });
  showVehicles(state.vehicles, cell.usesRing, jam);
  describeSelected();
  const speed = SLOTS_PER_FRAME[element("speed").value];
  const pace = speed < 1 ? `1/${Math.round(1 / speed)}` : String(speed);
  setText(element("speed-text"), `${pace} slots/frame`);
  element("speed").setAttribute("aria-valuetext", `${pace} slots a frame`);
  setText(element("vehicles-text"), element("vehicles").value);
  setText(element("c-min-text"), `${element("c-min").value} bit/s/Hz`);
}

function describeSelected() {
  const vehicle = state.vehicles[state.selected];
  if (!vehicle) return setText(element("vehicle"), "");
  const sent = vehicle.subChannel < 0 ? "silent" : `sent on sub-channel ${vehicle.subChannel + 1}, ${vehicle.received ? "received" : "lost"}`;
  const jammed = vehicle.jammed ? ", jammed" : "", place = state.cell.usesRing ? `, place ${placeOf(vehicle)}` : "";
  return setText(element("vehicle"), `Vehicle ${vehicle.index}${jammed}: age ${vehicle.age} ms${place}, ${sent} in the last slot`);
}

function say(words) { setText(element("message"), words); }

/** The controls as a link: #policy=aloha&vehicles=30&c-min=3&seed=7, and until=2500 to stop there. */
function remember() {
  const link = new URLSearchParams({ policy: state.policy });
  for (const id of ["vehicles", "c-min", "seed"]) link.set(id, element(id).value);
  history.replaceState(null, "", `#${link}`);
}

function recall() {
  const link = new URLSearchParams(location.hash.slice(1));
  for (const id of ["vehicles", "c-min", "seed", "speed"]) if (link.has(id)) element(id).value = link.get(id);
  if (link.has("policy")) state.policy = link.get("policy");
  const until = Number.parseInt(link.get("until"), 10);
  if (until > 0) state.until = until;
}

function select(by) {
  const count = state.vehicles.length;
  state.selected = ((state.selected ?? (by > 0 ? -1 : 0)) + by + count) % count;
  draw();
}

function onMapKey(event) {
  const moves = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
  if (event.key in moves) select(moves[event.key]);
  else if (event.key === "Enter" && state.selected !== null) jam(state.selected);
  else if (event.key === "Escape") { state.selected = null; draw(); }
  else return;
  event.preventDefault();
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input, select, textarea")) return;
  const key = event.key.toLowerCase();
  // Space on a button presses it.
  if (key === " " && !event.target.matches("button, summary")) run(!state.running);
  else if (key === "s") step();
  else if (key === "a") joinSomewhere();
  else return;
  event.preventDefault();
}

function listen() {
  const on = (id, type, act) => element(id).addEventListener(type, guarded(act));
  on("play", "click", () => run(!state.running));
  on("step", "click", step);
  on("add", "click", joinSomewhere);
  on("restart", "click", open);
  on("policy", "change", (event) => setPolicy(event.target.value));
  for (const id of ["vehicles", "c-min", "seed"]) on(id, "change", open);
  for (const id of ["vehicles", "c-min", "speed"]) on(id, "input", showTexts);
  on("map", "keydown", onMapKey);
  on("map", "click", ({ offsetX, offsetY }) => {
    const { vehicle, place } = find(canvas, state.cell.about.scenario, state.vehicles, offsetX, offsetY);
    if (vehicle) jam(vehicle.index);
    else join(...place);
  });
  document.addEventListener("keydown", guarded(onKey));
  new ResizeObserver(guarded(() => { drawScale(element("scale")); draw(); })).observe(stage);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", guarded(() => { drawScale(element("scale")); draw(); }));
}

/** An event's work; whatever goes wrong in it must not end the page. */
function guarded(act) {
  return (event) => {
    try { act(event); } catch (error) { recover(error); }
  };
}

async function start() {
  try {
    state.module = await load("freshlane.wasm");
    recall();
    open();
    // Only a refused link gets here without a world: begin with what always works.
    if (!state.cell) {
      const refusal = element("message").textContent;
      Object.assign(element("seed"), { value: "1" });
      open();
      say(refusal);
    }
    showLegend();
    drawScale(element("scale"));
    listen();
    run(!matchMedia("(prefers-reduced-motion: reduce)").matches);
    requestAnimationFrame(frame);
  } catch (error) {
    fail(error);
  }
}

start();
