// The map: streets, base station, vehicles with their ages, and who sent in the last slot.

import { paint, write } from "./canvas.js";
import { ageColour, colour, share } from "./colours.js";

const RADIUS = 9, REACH = 15, MARGIN_M = 20;

/** Where a place in metres lies on the canvas, and back. */
function projection(canvas, { mobility }) {
  const [width, height] = [mobility.blocks_x * mobility.block_x_m, mobility.blocks_y * mobility.block_y_m];
  const scale = Math.min(canvas.clientWidth / (width + 2 * MARGIN_M), canvas.clientHeight / (height + 2 * MARGIN_M));
  const left = (canvas.clientWidth - scale * width) / 2, bottom = (canvas.clientHeight + scale * height) / 2;
  return {
    scale, width, height,
    x: (metres) => left + scale * metres,
    y: (metres) => bottom - scale * metres,
    place: (x, y) => [(x - left) / scale, (bottom - y) / scale],
  };
}

/** The vehicle under a point of the canvas, if any, and the place in metres. */
export function find(canvas, scenario, vehicles, x, y) {
  const map = projection(canvas, scenario);
  const distances = vehicles.map((vehicle) => Math.hypot(map.x(vehicle.x) - x, map.y(vehicle.y) - y));
  const nearest = distances.indexOf(Math.min(...distances));
  return { vehicle: distances[nearest] <= REACH ? vehicles[nearest] : null, place: map.place(x, y) };
}

/** `ring` says whether the policy in charge goes by the ring: then those who were called are marked. */
export function drawMap(canvas, scenario, vehicles, selected, ring) {
  const map = projection(canvas, scenario);
  paint(canvas, (context) => {
    drawStreets(context, scenario, map);
    const { base_station_x_m: bx, base_station_y_m: by } = scenario.cell;
    const station = [map.x(bx), map.y(by)];
    for (const vehicle of vehicles) {
      if (vehicle.subChannel >= 0 && !vehicle.jammed) drawRay(context, vehicle, map, station);
    }
    drawStation(context, station);
    for (const vehicle of vehicles) drawVehicle(context, vehicle, map, vehicle.index === selected, ring && vehicle.called);
  });
}

function drawStreets(context, { mobility }, map) {
  const half = mobility.lane_width_m * mobility.lanes_per_direction;
  context.fillStyle = colour("street");
  context.fillRect(map.x(0), map.y(map.height), map.scale * map.width, map.scale * map.height);
  context.fillStyle = colour("block");
  for (let i = 0; i < mobility.blocks_x; i += 1) {
    for (let j = 0; j < mobility.blocks_y; j += 1) {
      const [x, y] = [map.x(i * mobility.block_x_m + half), map.y((j + 1) * mobility.block_y_m - half)];
      context.beginPath();
      context.roundRect(x, y, map.scale * (mobility.block_x_m - 2 * half), map.scale * (mobility.block_y_m - 2 * half), 4);
      context.fill();
    }
  }
}

function drawRay(context, vehicle, map, station) {
  context.strokeStyle = colour(vehicle.received ? "received" : "collided");
  context.setLineDash(vehicle.received ? [] : [3, 4]);
  context.lineWidth = vehicle.received ? 2 : 1.5;
  context.beginPath();
  context.moveTo(map.x(vehicle.x), map.y(vehicle.y));
  context.lineTo(...station);
  context.stroke();
  context.setLineDash([]);
}

function drawStation(context, [x, y]) {
  context.fillStyle = colour("panel");
  context.strokeStyle = colour("ink");
  context.lineWidth = 2;
  context.beginPath();
  context.arc(x, y - 4, 13, 0, 2 * Math.PI);
  context.fill();
  context.beginPath();
  context.moveTo(x - 6, y + 6);
  context.lineTo(x, y - 8);
  context.lineTo(x + 6, y + 6);
  context.moveTo(x - 3.5, y + 1);
  context.lineTo(x + 3.5, y + 1);
  context.stroke();
  context.beginPath();
  context.arc(x, y - 9, 4.5, Math.PI * 1.15, Math.PI * 1.85);
  context.moveTo(x - 7, y - 12);
  context.arc(x, y - 9, 8, Math.PI * 1.15, Math.PI * 1.85);
  context.stroke();
  write(context, "base station", x + 16, y - 4, { size: 11, colour: colour("quiet") });
}

function drawVehicle(context, vehicle, map, selected, called) {
  const [x, y] = [map.x(vehicle.x), map.y(vehicle.y)], age = ageColour(vehicle.age);
  const ring = (radius, name, width) => {
    context.strokeStyle = colour(name);
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  };
  context.fillStyle = age.fill;
  context.beginPath();
  context.arc(x, y, RADIUS, 0, 2 * Math.PI);
  context.fill();
  ring(RADIUS, vehicle.jammed ? "collided" : "rim", vehicle.jammed ? 3 : 1.25);
  if (called) ring(RADIUS + 2, "called", 2);
  if (selected) ring(RADIUS + 4, "ink", 2);
  write(context, String(vehicle.age), x, y + 0.5, { size: vehicle.age > 999 ? 6.5 : vehicle.age > 99 ? 9 : 10.5, align: "center", colour: age.ink, weight: 600 });
  if (vehicle.jammed) {
    context.strokeStyle = colour("collided");
    context.lineWidth = 2.5;
    context.beginPath();
    context.moveTo(x - 10, y + 10);
    context.lineTo(x + 10, y - 10);
    context.stroke();
  }
}

export function drawScale(canvas) {
  paint(canvas, (context, width) => {
    const [left, right] = [2, width - 30];
    for (let x = left; x < right; x += 1) {
      context.fillStyle = ageColour(100 ** ((x - left) / (right - left))).fill;
      context.fillRect(x, 2, 1.5, 11);
    }
    for (const age of [1, 2, 5, 10, 20, 50, 100]) {
      const words = age === 100 ? "100 ms" : String(age), x = left + share(age) * (right - left);
      write(context, words, x, 24, { size: 11, align: age === 1 ? "left" : "center", colour: colour("quiet") });
    }
  });
}
