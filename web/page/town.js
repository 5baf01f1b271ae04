// The town: the same traffic and the same incident twice, without advice and with what vehicles report. The program runs it ahead
// (web/src/town.rs); here its pictures are shown one after the other.

import { paint, write } from "./canvas.js";
import { colour } from "./colours.js";
import { Program } from "./program.js";

const SIDES = ["blind", "heard"];
/** Seconds of traffic in a second of the visitor's. */
const PACE = 60;
/** Longest time since the frame before that counts, in ms. */
const FRAME_MS = 100;
/** How long after its beginning an incident has a queue to show, in s: what stands there where nothing may move. */
const TELLING_S = 420;
const MARGIN_PX = 14, VEHICLE_PX = 2.4;

const element = (id) => document.getElementById(id);

export class Town {
  #program; #starts; #numbers; #time = 0; #frameAt = 0; #incidents;
  running = false;

  /** Runs both sides ahead, which takes a second or two. Throws a Refusal. */
  constructor(module, request) {
    this.#program = new Program(module);
    const { exports } = this.#program;
    this.about = JSON.parse(this.#program.ask(exports.town_open, JSON.stringify(request)));
    const { pictures, vehicle_numbers: width, incident, roads } = this.about;
    this.#starts = SIDES.map((_, side) => this.#program.view(Uint32Array, exports.town_starts(side), pictures + 1).slice());
    this.#numbers = SIDES.map((_, side) => this.#program.view(Float32Array, exports.town_numbers(side), width * this.#starts[side][pictures]).slice());
    this.#incidents = roads[incident.road];
    element("town-time").max = pictures - 1;
  }

  /** From the beginning; where nothing may move, the picture that tells most. */
  begin(still) {
    const { incident, from_s: from, look_s: look } = this.about;
    this.#time = still ? (incident.from_s + TELLING_S - from) / look : 0;
    this.run(!still);
    this.draw();
  }

  run(running) {
    this.running = running;
    this.#frameAt = performance.now();
    if (running && this.#time >= this.about.pictures - 1) this.#time = 0;
    element("town-play").textContent = running ? "Pause" : "Run";
  }

  /** To the picture that a visitor asks for. */
  seek(picture) {
    this.run(false);
    this.#time = picture;
    this.draw();
  }

  frame(now) {
    if (!this.running) return;
    const passed = Math.min(Math.max(now - this.#frameAt, 0), FRAME_MS) / 1000;
    this.#frameAt = now;
    this.#time = Math.min(this.#time + passed * PACE / this.about.look_s, this.about.pictures - 1);
    if (this.#time >= this.about.pictures - 1) this.run(false);
    this.draw();
  }

  draw() {
    const picture = Math.floor(this.#time), seconds = this.about.from_s + picture * this.about.look_s, { incident } = this.about;
    const now = seconds >= incident.from_s && seconds < incident.to_s;
    SIDES.forEach((name, side) => {
      const vehicles = this.#vehicles(side, picture), queued = vehicles.filter(({ queued }) => queued).length;
      drawTown(element(`${name}-map`), this.about, this.#incidents, vehicles, now);
      element(`${name}-queue`).textContent = `${queued} in a queue`;
    });
    element("town-time").value = picture;
    const clock = `minute ${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
    element("town-clock").textContent = clock;
    element("town-time").setAttribute("aria-valuetext", clock);
    const when = now ? "The incident." : seconds < incident.from_s ? "Nothing has happened yet." : "The incident is over.";
    element("town-words").textContent = `${when} ${this.#result()}`;
  }

  #result() {
    const [blind, heard] = this.about.trip_times_s, { mean_age_ms: age } = this.about;
    return `Over the half hour a trip takes ${blind.toFixed(0)} s on the left and ${heard.toFixed(0)} s on the right, where reports are ${age.toFixed(0)} ms old.`;
  }

  #vehicles(side, picture) {
    const width = this.about.vehicle_numbers, numbers = this.#numbers[side];
    const vehicles = [];
    for (let index = this.#starts[side][picture]; index < this.#starts[side][picture + 1]; index += 1) {
      const [x, y, queued] = numbers.subarray(index * width, (index + 1) * width);
      vehicles.push({ x, y, queued: queued > 0 });
    }
    return vehicles;
  }
}

function drawTown(canvas, { roads, station }, incident, vehicles, now) {
  const [width, height] = [0, 1].map((axis) => Math.max(...roads.flat().map((place) => place[axis])));
  paint(canvas, (context, room, depth) => {
    const scale = Math.min((room - 2 * MARGIN_PX) / width, (depth - 2 * MARGIN_PX) / height);
    const x = (metres) => (room - scale * width) / 2 + scale * metres, y = (metres) => (depth + scale * height) / 2 - scale * metres;
    const street = ([from, to], name, size) => {
      context.strokeStyle = colour(name);
      context.lineWidth = size;
      context.beginPath();
      context.moveTo(x(from[0]), y(from[1]));
      context.lineTo(x(to[0]), y(to[1]));
      context.stroke();
    };
    for (const road of roads) street(road, "street", 9);
    if (now) street(incident, "jammed", 13);
    for (const queued of [false, true]) {
      context.fillStyle = colour(queued ? "collided" : "received");
      for (const vehicle of vehicles.filter((vehicle) => vehicle.queued === queued)) {
        context.beginPath();
        context.arc(x(vehicle.x), y(vehicle.y), VEHICLE_PX, 0, 2 * Math.PI);
        context.fill();
      }
    }
    const [dot, place] = [[x(station[0]), y(station[1])], incident[0].map((from, axis) => (from + incident[1][axis]) / 2)];
    context.fillStyle = colour("ink");
    context.fillRect(dot[0] - 4, dot[1] - 4, 8, 8);
    if (now) write(context, "incident", x(place[0]) + 10, y(place[1]) - 12, { size: 12, weight: 600, colour: colour("ink") });
  });
}
