// The page: controls in, pictures out. The simulation itself is in cell.js and the program behind it.

import { Cell, Refusal, load } from "./cell.js";
import { drawAges, drawOccupancy, mean } from "./charts.js";
import { DEFAULTS, IMPERFECTIONS, SPEEDS, speedWords } from "./choices.js";
import { colour, policyColour } from "./colours.js";
import { read, write } from "./links.js";
import { drawMap, drawScale, find } from "./map.js";
import { placeOf, setText, showCommand, showLegend, showSummaries, showVehicles } from "./tables.js";
import { STEPS } from "./tour.js";
import { Town } from "./town.js";

const COMPARISONS = ["central", "age-threshold"];
/** What decides where the network does not serve: the rules that it was distilled from. */
const STAND_IN = "clock";
/** Time of a frame that slots may take, so that the picture stays smooth on a slow machine. */
const SLOTS_MS = 10;
/** Longest time since the frame before that counts: a page in the background does not catch up. */
const FRAME_MS = 100;
const TEXTS_EVERY_MS = 125;
/** Time in which the page says what it waits for, before the town keeps it busy. */
const TOWN_AFTER_MS = 50;
/** Slots whose mean age stands above a map. */
const SHOWN_SLOTS = 50;
/** Slots before the first picture where nothing may move, so that it tells something. */
const STILL_SLOTS = 150;

const element = (id) => document.getElementById(id);
const stage = element("cell"), canvas = element("map"), still = matchMedia("(prefers-reduced-motion: reduce)");

const state = {
  module: null, cell: null, beside: null, vehicles: [],
  /** The tour's last step; null before it was first there. */
  town: null,
  /** What links are checked against: the policies' names, and room for vehicles. */
  known: null,
  /** The controls as a link has them, and those of the world that runs. */
  values: DEFAULTS, opened: DEFAULTS,
  running: true, selected: null,
  /** Changes by hand since the start, { slot, words }: the command line knows none. */
  changes: [],
  debt: 0, msPerSlot: 0.05, frameAt: 0, slots: 0, textsAt: 0, joined: 0,
};

/** Whether towns are shown in the place of cells. */
const inTown = () => Boolean(STEPS[state.values.step].town);
const until = () => Number(state.values.until || Infinity);
const settingsOf = (values) => [
  `cell.vehicles=${values.vehicles}`, `radio.min_spectral_efficiency=${values["c-min"]}`, ...IMPERFECTIONS[values.imperfections].settings,
];

/** New worlds as the controls say, one for each side. Where they are refused, those before go on, and the answer is `false`. */
function open(refusals = []) {
  const { values } = state, words = [...refusals];
  const cellOf = (control, comparisons) => {
    const request = (policy) => ({ seed: values.seed, settings: settingsOf(values), policy, comparisons });
    try {
      return new Cell(state.module, request(values[control]));
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      const cell = new Cell(state.module, request(STAND_IN));
      words.push(`The ${values[control]} does not serve this cell (${error.message}). The ${STAND_IN} decides instead.`);
      return cell;
    }
  };
  try {
    const [cell, beside] = [cellOf("policy", COMPARISONS), cellOf("beside", [])];
    Object.assign(state, { cell, beside, opened: values, changes: [], selected: null, debt: 0, slots: 0, joined: 0 });
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    say([...refusals, `Not possible: ${error.message}.`].join(" "));
    return false;
  }
  offerPolicies();
  for (const vehicle of STEPS[values.step].jammed ?? []) cut(vehicle, true);
  if (still.matches) advance(Math.min(STILL_SLOTS, until()));
  showTour();
  say(words.join(" "));
  draw();
  return true;
}

const sides = () => [{ control: "policy", cell: state.cell, map: canvas }, { control: "beside", cell: state.beside, map: element("beside-map") }];

function offerPolicies() {
  for (const { control, cell } of sides()) {
    const options = cell.about.policies.map(({ name, meaning, refused }) => {
      const option = new Option(refused ? `${name} (not in this cell)` : name, name);
      option.disabled = Boolean(refused);
      option.title = meaning;
      return option;
    });
    element(control).replaceChildren(...options);
    element(control).value = cell.runs[0];
  }
}

/** A control's new value, and a new world with it, if there is one. */
function choose(control, text) {
  const before = state.values;
  state.values = { ...before, [control]: text };
  if (open()) remember();
  else state.values = before;
}

/** Another policy takes over in the running world. */
function setPolicy(name) {
  const before = state.cell.runs[0];
  try {
    state.cell.setPolicy(name);
    state.beside.countAnew();
    state.values = { ...state.values, policy: name };
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

/** Jams a vehicle on both sides, or lets it go. */
function cut(index, on) {
  if (!sides().every(({ cell }) => cell.jam(index, on))) return false;
  state.changes.push({ slot: state.cell.elapsed, words: `${index} is ${on ? "jammed" : "free"}` });
  return true;
}

function jam(index) {
  const vehicle = state.vehicles[index];
  if (!vehicle || !cut(index, !vehicle.jammed)) return;
  state.selected = index;
  draw();
}

function join(x, y) {
  if (sides().every(({ cell }) => cell.join(x, y))) {
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

function advance(slots) {
  for (const { cell } of sides()) cell.advance(slots);
  state.slots = slots;
}

function run(running) {
  state.running = running;
  state.frameAt = performance.now();
  element("play").textContent = running ? "Pause" : "Run";
  if (running && state.cell.elapsed >= until()) {
    state.values = { ...state.values, until: "" };
    remember();
  }
  showTexts();
}

function oneSlot() {
  run(false);
  advance(1);
  draw();
}

/** Slots for this frame at the chosen speed, within its time. */
function slotsOfFrame(now) {
  const passed_ms = Math.min(Math.max(now - state.frameAt, 0), FRAME_MS);
  state.frameAt = now;
  state.debt += passed_ms * SPEEDS.get(state.values.speed);
  const whole = Math.floor(state.debt);
  state.debt -= whole;
  return Math.min(whole, Math.max(1, Math.floor(SLOTS_MS / state.msPerSlot)), until() - state.cell.elapsed);
}

function frame(now) {
  requestAnimationFrame(frame);
  if (!state.cell) return;
  if (inTown()) return guarded(() => state.town?.frame(now))();
  if (!state.running) return;
  try {
    const begin = performance.now(), slots = slotsOfFrame(now);
    if (slots > 0) {
      advance(slots);
      state.msPerSlot += 0.1 * ((performance.now() - begin) / slots - state.msPerSlot);
      drawPictures();
    }
    if (performance.now() - state.textsAt > TEXTS_EVERY_MS) showTexts();
    const { elapsed } = state.cell;
    if (elapsed >= until() || elapsed >= state.cell.about.most_slots) run(false);
  } catch (error) {
    recover(error);
  }
}

/** A program that stopped leaves its instance unusable: say so and begin a new one. */
function recover(error) {
  console.error(error);
  run(false);
  try {
    open([`The simulation stopped (${error.message}). This is a new world with the same settings.`]);
  } catch (again) {
    fail(again);
  }
}

function fail(error) {
  console.error(error);
  stage.dataset.state = "failed";
  setText(element("absent"), `The cell cannot run here: ${error.message}. The page needs all of its files, from a file server (python3 -m http.server --directory web/page), and a browser of 2023 or later.`);
  element("absent").hidden = false;
}

function draw() {
  drawPictures();
  showTexts();
}

function drawPictures() {
  for (const { cell, map } of sides()) {
    const vehicles = cell.vehicles();
    if (map === canvas) state.vehicles = vehicles;
    drawMap(map, cell, vehicles, state.selected, state.slots);
  }
  const { cell, beside, changes } = state;
  drawAges(element("age-chart"), cell, [...cell.histories(), ...beside.histories()], changes);
  drawOccupancy(element("occupancy"), cell);
}

function showTexts() {
  const { cell, beside, values, opened } = state;
  state.textsAt = performance.now();
  stage.dataset.state = state.running ? "running" : "paused";
  stage.dataset.elapsed = cell.elapsed;
  for (const side of sides()) showSide(side);
  showSummaries(cell, [...cell.summaries(), ...beside.summaries()]);
  showCommand(cell, [...cell.runs, ...beside.runs], { seed: opened.seed, settings: settingsOf(opened), running: state.running, changes: state.changes });
  showVehicles(state.vehicles, cell.usesRing, jam);
  describeSelected();
  setText(element("speed-text"), speedWords(values.speed));
  element("speed").setAttribute("aria-valuetext", speedWords(values.speed));
  const joined = state.vehicles.length - Number(opened.vehicles);
  setText(element("vehicles-text"), joined > 0 ? `${opened.vehicles} + ${joined}` : element("vehicles").value);
  setText(element("c-min-text"), `${element("c-min").value} bit/s/Hz`);
}

/** The heading of a map: its policy, and the mean age of the last slots. */
function showSide({ control, cell }) {
  const [{ policy, history }] = cell.histories(), { elapsed } = cell;
  setText(element(`${control}-name`), policy);
  element(`${control}-swatch`).style.background = colour(policyColour(policy));
  setText(element(`${control}-age`), elapsed === 0 ? "" : `${mean(history, Math.max(0, elapsed - SHOWN_SLOTS), elapsed).toFixed(1)} ms`);
}

function describeSelected() {
  const vehicle = state.vehicles[state.selected];
  if (!vehicle) return setText(element("vehicle"), "");
  const sent = vehicle.subChannel < 0 ? "silent" : `sent on sub-channel ${vehicle.subChannel + 1}, ${vehicle.received ? "received" : "lost"}`;
  const jammed = vehicle.jammed ? ", jammed" : "", place = state.cell.usesRing ? `, place ${placeOf(vehicle)}` : "";
  return setText(element("vehicle"), `Vehicle ${vehicle.index}${jammed}: age ${vehicle.age} ms${place}, ${sent} in the last slot`);
}

function say(words) { setText(element("message"), words); }

function showTour() {
  const step = Number(state.values.step), { title, text } = STEPS[step];
  setText(element("tour-heading"), step === 0 ? title : `${step} of ${STEPS.length - 1}: ${title}`);
  setText(element("tour-text"), text);
  setText(element("tour-next"), step === 0 ? "Take the tour" : "Next");
  element("tour-next").disabled = step === STEPS.length - 1;
  element("tour-back").disabled = step === 0;
  if (inTown()) showTown();
  else stage.removeAttribute("data-scene");
}

/** The tour's last step. It is run ahead once, after the page has said so. */
function showTown() {
  stage.dataset.scene = "town";
  if (state.town) return state.town.begin(still.matches);
  return setTimeout(guarded(() => {
    if (!inTown()) return;
    state.town ??= new Town(state.module, { seed: DEFAULTS.seed, policy: DEFAULTS.policy });
    setText(element("town-wait"), "");
    element("town-stage").hidden = false;
    state.town.begin(still.matches);
  }), TOWN_AFTER_MS);
}

/** A step of the tour: its controls, a new world. */
function go(by) {
  const step = String(Number(state.values.step) + by);
  if (!Object.hasOwn(STEPS, step)) return;
  state.values = { ...DEFAULTS, keys: state.values.keys, ...STEPS[step].controls, step };
  showControls();
  open();
  remember();
  run(!still.matches);
}

/** The controls as they are into the link; `replace` makes no new entry of the history. */
function remember(replace = false) {
  const link = write(state.values);
  if (link !== location.hash) history[replace ? "replaceState" : "pushState"](null, "", link);
}

/** The link into the controls, and a new world. What the link asks for in vain is said, and is no longer in it. */
function recall() {
  const { values, refusals } = read(location.hash, state.known);
  state.values = values;
  showControls();
  open(refusals.map((words) => `${words}.`));
  remember(true);
}

function showControls() {
  const { values } = state;
  for (const id of ["vehicles", "c-min", "imperfections", "seed"]) element(id).value = values[id];
  element("speed").value = [...SPEEDS.keys()].indexOf(values.speed);
  element("keys").checked = values.keys === "on";
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
  const key = event.key.toLowerCase(), letters = state.values.keys === "on";
  // Space on a button presses it.
  if (key === " " && event.target.matches("button, summary")) return;
  if (inTown()) {
    if (key !== " ") return;
    state.town?.run(!state.town.running);
  } else if (key === " ") run(!state.running);
  else if (letters && key === "s") oneSlot();
  else if (letters && key === "a") joinSomewhere();
  else return;
  event.preventDefault();
}

function listen() {
  const on = (id, type, act) => element(id).addEventListener(type, guarded(act));
  on("play", "click", () => run(!state.running));
  on("step", "click", oneSlot);
  on("add", "click", joinSomewhere);
  on("restart", "click", () => open());
  on("town-play", "click", () => state.town.run(!state.town.running));
  on("town-time", "input", (event) => state.town.seek(Number(event.target.value)));
  on("tour-back", "click", () => go(-1));
  on("tour-next", "click", () => go(1));
  on("policy", "change", (event) => setPolicy(event.target.value));
  for (const id of ["beside", "vehicles", "c-min", "imperfections", "seed"]) on(id, "change", (event) => choose(id, event.target.value.trim()));
  for (const id of ["vehicles", "c-min"]) on(id, "input", showTexts);
  on("speed", "input", (event) => {
    state.values = { ...state.values, speed: [...SPEEDS.keys()][event.target.value] };
    remember(true);
    showTexts();
  });
  on("keys", "change", (event) => {
    state.values = { ...state.values, keys: event.target.checked ? "on" : "off" };
    remember(true);
  });
  on("map", "keydown", onMapKey);
  for (const { map } of sides()) {
    map.addEventListener("click", guarded(({ offsetX, offsetY }) => {
      const { vehicle, place } = find(map, state.cell.about.scenario, state.vehicles, offsetX, offsetY);
      if (vehicle) jam(vehicle.index);
      else join(...place);
    }));
  }
  document.addEventListener("keydown", guarded(onKey));
  addEventListener("hashchange", guarded(() => { recall(); run(!still.matches); }));
  const redraw = guarded(() => {
    if (inTown()) return state.town?.draw();
    drawScale(element("scale"));
    return draw();
  });
  new ResizeObserver(redraw).observe(stage);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  still.addEventListener("change", guarded(() => { if (still.matches) { run(false); state.town?.run(false); } }));
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
    // A world that always works says which policies there are and how many vehicles fit.
    const { about } = new Cell(state.module, { seed: DEFAULTS.seed, settings: [], policy: DEFAULTS.policy, comparisons: [] });
    state.known = { policies: about.policies.map(({ name }) => name), room: about.room };
    element("vehicles").max = about.room;
    element("speed").max = SPEEDS.size - 1;
    element("imperfections").replaceChildren(...Object.entries(IMPERFECTIONS).map(([name, { words }]) => new Option(words, name)));
    stage.hidden = false;
    element("absent").hidden = true;
    recall();
    showLegend();
    drawScale(element("scale"));
    listen();
    run(!still.matches);
    requestAnimationFrame(frame);
  } catch (error) {
    fail(error);
  }
}

start();
