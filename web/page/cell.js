// The simulation: a thin wrapper around the exported functions (web/src/exports.rs), one instance for each world.

import { Program } from "./program.js";

export { Refusal, load } from "./program.js";

/** Where in a vehicle's numbers its sub-channel of the last slot stands, and whether it was received (`VEHICLE_NUMBERS` there). */
const SENT_ON = 3, RECEIVED = 4;

export class Cell {
  #program;
  #exports;
  /** By vehicle: how many slots before the last one it was received, and not received, in the last `advance`; undefined if never. */
  sent = { received: [], lost: [] };

  /** The world that `request` asks for (web/src/session.rs, `Request`), before its first slot. Throws a Refusal. */
  constructor(module, request) {
    this.#program = new Program(module);
    this.#exports = this.#program.exports;
    this.about = JSON.parse(this.#program.ask(this.#exports.cell_open, JSON.stringify(request)));
    this.runs = this.about.runs;
  }

  /** A new policy for the first run. Throws a Refusal. */
  setPolicy(name) {
    this.#program.ask(this.#exports.cell_set_policy, name);
    this.runs = [name, ...this.runs.slice(1)];
  }

  /** Whether the policy in charge goes by the base station's ring. */
  get usesRing() { return this.about.policies.find(({ name }) => name === this.runs[0]).ring; }

  /** Carries out slots, one by one so that everybody who sends is noted. */
  advance(slots) {
    this.sent = { received: [], lost: [] };
    const width = this.about.layout.vehicle_numbers;
    for (let left = slots - 1; left >= 0; left -= 1) {
      this.#exports.cell_advance(1);
      const count = this.#exports.cell_vehicle_count(), numbers = this.#program.view(Float32Array, this.#exports.cell_vehicles(), count * width);
      for (let index = 0; index < count; index += 1) {
        const at = index * width;
        if (numbers[at + SENT_ON] >= 0) this.sent[numbers[at + RECEIVED] > 0 ? "received" : "lost"][index] = left;
      }
    }
  }

  /** Begins to count ages anew: a jam that ends before the next slot does that, and nothing else. */
  countAnew() {
    const { jammed } = this.vehicles()[0];
    this.jam(0, !jammed);
    this.jam(0, jammed);
  }

  jam(vehicle, on) { return Boolean(this.#exports.cell_jam(vehicle, on)); }
  join(x, y) { return Boolean(this.#exports.cell_join(x, y)); }

  get elapsed() { return this.#exports.cell_elapsed() >>> 0; }
  get countFrom() { return this.#exports.cell_count_from() >>> 0; }
  get bound() { return this.#exports.cell_bound_age_ms(); }

  /** Every vehicle as of now. */
  vehicles() {
    const width = this.about.layout.vehicle_numbers, count = this.#exports.cell_vehicle_count();
    const numbers = this.#program.view(Float32Array, this.#exports.cell_vehicles(), count * width);
    return Array.from({ length: count }, (_, index) => {
      const [x, y, age, subChannel, received, jammed, place, called] = numbers.subarray(index * width, (index + 1) * width);
      return { index, x, y, age, subChannel, received: received > 0, jammed: jammed > 0, place, called: called > 0 };
    });
  }

  /** For every run: mean age, 99th percentile and receptions a slot; NaN until ages count. */
  summaries() {
    const width = this.about.layout.summary_numbers;
    const numbers = this.#program.view(Float64Array, this.#exports.cell_summaries(), this.runs.length * width);
    return this.runs.map((policy, run) => {
      const [mean, p99, received] = numbers.subarray(run * width, (run + 1) * width);
      return { policy, mean, p99, received };
    });
  }

  /** Mean age after slot `slot` of a run, for the last slots. */
  history(run) {
    const length = this.about.layout.history_slots;
    const ring = this.#program.view(Float32Array, this.#exports.cell_history_ms(run), length);
    return (slot) => ring[slot % length];
  }

  /** The policies of all runs, each with its history. */
  histories() { return this.runs.map((policy, run) => ({ policy, history: this.history(run) })); }

  /** How a sub-channel was used in a slot of the first run, for the last slots. */
  occupancy() {
    const { occupancy_slots: length, use_bytes: width, nobody } = this.about.layout;
    const subChannels = this.about.scenario.radio.sub_channels;
    const ring = this.#program.view(Uint8Array, this.#exports.cell_occupancy(), length * subChannels * width);
    return (slot, subChannel) => {
      const at = ((slot % length) * subChannels + subChannel) * width;
      return { senders: ring[at], jammed: ring[at + 1], received: ring[at + 2] === nobody ? null : ring[at + 2], open: ring[at + 3] > 0 };
    };
  }
}
