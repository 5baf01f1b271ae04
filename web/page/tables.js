// What the page says in words and numbers.

import { grouped } from "./canvas.js";
import { DASHES, OPEN, USES, colour, policyColour } from "./colours.js";

const element = (id) => document.getElementById(id);

/** Writes a text where it differs, so that screen readers hear changes only. */
export function setText(node, words) {
  if (node.textContent !== words) node.textContent = words;
}

function make(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

/** A table's rows: as many as `count`, each made once and then updated. */
function rows(body, count, create) {
  while (body.rows.length > count) body.lastElementChild.remove();
  while (body.rows.length < count) body.append(create(body.rows.length));
  return [...body.rows];
}

const number = (value, digits, unit = "") => (Number.isNaN(value) ? "–" : value.toFixed(digits) + unit);

/** `runs` are the summaries of the policies, the one in charge first. */
export function showSummaries(cell, runs) {
  const summaries = [...runs, { policy: "bound", mean: cell.bound, p99: NaN, received: NaN }];
  const create = () => {
    const row = make("tr", {}, make("th", { scope: "row" }, make("span", { className: "swatch" }), make("span")));
    row.append(make("td", {}, make("data")), make("td"), make("td"));
    return row;
  };
  rows(element("summaries"), summaries.length, create).forEach((row, index) => {
    const { policy, mean, p99, received } = summaries[index], bound = policy === "bound";
    const [swatch, words] = row.cells[0].children;
    swatch.style.borderTopColor = colour(bound ? "ink" : policyColour(policy));
    swatch.style.borderTopStyle = bound ? "dotted" : index > 0 && DASHES[policy].length ? "dashed" : "solid";
    setText(words, policy);
    const data = row.cells[1].firstElementChild;
    Object.assign(data.dataset, { policy, run: bound ? "bound" : index });
    data.value = String(mean);
    setText(data, number(mean, 2, " ms"));
    setText(row.cells[2], bound ? "" : number(p99, 0, " ms"));
    setText(row.cells[3], bound ? "" : number(received, 3));
  });
  const { elapsed, countFrom } = cell;
  setText(element("counted"), elapsed > countFrom
    ? `Over slots ${grouped(countFrom)} to ${grouped(elapsed)}.`
    : `Ages count from slot ${grouped(countFrom)} on; now ${grouped(elapsed)}.`);
}

/** `names` are the policies that are shown. */
export function showCommand(cell, names, { seed, settings, running, changes }) {
  const counted = cell.elapsed - cell.countFrom, policies = [...new Set(names)].map((name) => `--policy ${name}`).join(" ");
  let note = `These print the page’s ${grouped(counted)} slots to the last digit:`;
  if (running) note = "Pause: a command for the slots until then stands here.";
  else if (changes.length > 0) note = `This world was changed by hand in slot ${grouped(changes[0].slot)}, which the command line cannot repeat. Start again for one that it can.`;
  else if (counted < 1) note = "Ages do not count yet.";
  const possible = !running && changes.length === 0 && counted >= 1;
  const scenario = settings.map((setting) => `--set ${setting}`).join(" ");
  setText(element("command-note"), note);
  setText(element("command"), possible
    ? `cargo run --release -- run --worlds 1 --seed ${seed} --slots ${counted} ${scenario} ${policies} --json`
    : "");
  element("command").parentElement.hidden = !possible;
}

/** A vehicle's place in the ring, in words. */
export const placeOf = ({ place, called }) => (place < 0 ? "none" : String(place)) + (called ? ", called" : "");

/** `ring` says whether the policy in charge goes by the ring. */
export function showVehicles(vehicles, ring, jam) {
  if (!element("vehicle-table").open) return;
  const create = (index) => {
    const button = make("button", { type: "button" });
    button.addEventListener("click", () => jam(index));
    return make("tr", {}, make("th", { scope: "row", textContent: String(index) }), make("td"), make("td"), make("td"), make("td"), make("td", {}, button));
  };
  rows(element("vehicle-rows"), vehicles.length, create).forEach((row, index) => {
    const { age, subChannel, received, x, y, jammed, place, called } = vehicles[index];
    setText(row.cells[1], `${age} ms`);
    setText(row.cells[2], subChannel < 0 ? "silent" : `sub-channel ${subChannel + 1}, ${received ? "received" : "lost"}`);
    setText(row.cells[3], ring ? placeOf({ place, called }) : "–");
    setText(row.cells[4], `${x.toFixed(0)}, ${y.toFixed(0)} m`);
    const button = row.cells[5].firstElementChild;
    setText(button, jammed ? "Free" : "Jam");
    button.setAttribute("aria-label", `${jammed ? "Free" : "Jam"} vehicle ${index}`);
  });
}

/** The legend of the kinds of use. */
export function showLegend() {
  const items = Object.entries(USES).map(([kind, { name, height }]) => {
    const sample = make("span", { className: `use ${kind}` });
    sample.style.height = `${13 * height}px`;
    return make("li", {}, sample, name);
  });
  items.push(make("li", {}, make("span", { className: "use open" }), OPEN));
  element("legend").replaceChildren(...items);
}
