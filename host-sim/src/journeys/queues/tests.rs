//! Rules of the built-in traffic, each on roads of its own.

use super::*;

/// A chain of roads, each 500 m long at 10 m/s with one lane of 1,800 veh/h but for the last, which has `last`.
fn chain(count: u32, last: f64) -> RoadMap {
    let road = |index: u32| Road {
        from: index,
        to: index + 1,
        length_m: 500.0,
        free_speed_m_per_s: 10.0,
        lanes: 1,
        capacity_veh_per_h: if index + 1 == count { last } else { 1800.0 },
        block: Some(index),
    };
    let places = (0..=count).map(|node| (500.0 * f64::from(node), 0.0)).collect();
    RoadMap::new((0..count).map(road).collect(), places).unwrap()
}

fn arrivals(
    map: &RoadMap,
    incidents: &Incidents,
    departures_s: &[f64],
    route: &[u32],
    step_s: f64,
) -> Vec<f64> {
    let mut queues = Queues::new(map, incidents);
    let mut arrived = Vec::new();
    let mut departed = 0;
    let mut time_s = 0.0;
    while arrived.len() < departures_s.len() {
        while departed < departures_s.len() && departures_s[departed] <= time_s {
            queues.depart(departed as u32, route).unwrap();
            departed += 1;
        }
        time_s += step_s;
        queues.advance(time_s, &mut arrived).unwrap();
        assert!(time_s < 1e5, "{arrived:?}");
    }
    let mut times = vec![0.0; departures_s.len()];
    for arrival in arrived {
        times[arrival.vehicle as usize] = arrival.time_s;
    }
    times
}

#[test]
fn alone_a_vehicle_takes_the_free_time() {
    let map = chain(3, 1800.0);
    let times = arrivals(&map, &Incidents::none(3), &[0.0], &[0, 1, 2], 1.0);
    assert_eq!(times, [150.0]);
}

#[test]
fn a_road_carries_its_capacity_as_long_as_nobody_queues() {
    let map = chain(3, 1800.0);
    let departures: Vec<f64> = (0..300).map(|n| f64::from(2 * n)).collect();
    let times = arrivals(&map, &Incidents::none(3), &departures, &[0, 1, 2], 1.0);
    for (departs_s, arrives_s) in departures.iter().zip(&times) {
        assert!((arrives_s - departs_s - 150.0).abs() < 1e-6, "{times:?}");
    }
}

#[test]
fn a_queue_before_a_bottleneck_passes_less_than_its_capacity_and_spills_back() {
    let map = chain(3, 600.0);
    let departures: Vec<f64> = (0..200).map(|n| f64::from(2 * n)).collect();
    let times = arrivals(&map, &Incidents::none(3), &departures, &[0, 1, 2], 1.0);
    // The second is held up for 4 s, as long as a stop from 10 m/s costs, the third for 8: it stood, and the next waits longer.
    assert_eq!(times[..3], [150.0, 156.0, 162.0]);
    for (n, time_s) in times.iter().enumerate().skip(3) {
        let expected_s = 162.0 + 6.0 / (1.0 - CAPACITY_DROP) * (n as f64 - 2.0);
        assert!((time_s - expected_s).abs() < 1e-6, "{n}: {time_s} {expected_s}");
    }
    // 66 vehicles stand on 500 m: after 400 s the queue of 200 - 42 reaches through two roads into the first.
    let incidents = Incidents::none(3);
    let mut queues = Queues::new(&map, &incidents);
    let mut arrived = Vec::new();
    for n in 0..200 {
        queues.advance(f64::from(2 * n), &mut arrived).unwrap();
        queues.depart(n, &[0, 1, 2]).unwrap();
    }
    let mut vehicles = Vec::new();
    queues.on_roads(&mut vehicles).unwrap();
    let on = |road| vehicles.iter().filter(|vehicle| vehicle.road == road).count();
    // At 600 veh/h the last road is in the free branch: what waits stands before it.
    assert!((8..=9).contains(&on(2)), "{}", on(2));
    assert!(on(1) >= 45 && on(0) > 20, "{} {}", on(1), on(0));
}

#[test]
fn a_jam_flows_at_the_speed_of_its_density() {
    // On the triangular diagram what the bottleneck lets through flows at this density in the queue before it.
    let map = chain(2, 600.0);
    let incidents = Incidents::none(2);
    let mut queues = Queues::new(&map, &incidents);
    let mut arrived = Vec::new();
    for n in 0..400 {
        queues.advance(f64::from(2 * n), &mut arrived).unwrap();
        queues.depart(n, &[0, 1]).unwrap();
    }
    let mut vehicles = Vec::new();
    queues.on_roads(&mut vehicles).unwrap();
    let on = vehicles.iter().filter(|vehicle| vehicle.road == 0).count();
    // A vehicle takes its spacing and the way that the headway leaves beyond the reaction time.
    let share_moving = map.roads()[0].reaction_time_s() / (6.0 / (1.0 - CAPACITY_DROP));
    let expected = 500.0 * (1.0 - share_moving) / SPACING_M;
    assert!((on as f64 - expected).abs() < 2.0, "{on} against {expected}");
}

#[test]
fn an_incident_slows_and_its_end_frees() {
    let map = chain(1, 1800.0);
    let incidents = Incidents::scripted(vec![vec![(20.0, 120.0)]], 0.4);
    let crawl = map.roads()[0].crawl_speed_m_per_s(0.4);
    let times = arrivals(&map, &incidents, &[0.0], &[0], 1.0);
    let expected = 120.0 + (500.0 - 200.0 - 100.0 * crawl) / 10.0;
    assert!((times[0] - expected).abs() < 1e-9, "{} {expected}", times[0]);
}

#[test]
fn looking_more_often_changes_nothing() {
    let map = chain(3, 700.0);
    let incidents = Incidents::scripted(vec![vec![(30.0, 90.0)], vec![], vec![(100.0, 300.0)]], 0.3);
    let departures: Vec<f64> = (0..100).map(|n| f64::from(2 * n)).collect();
    let of = |step_s| arrivals(&map, &incidents, &departures, &[0, 1, 2], step_s);
    assert_eq!(of(2.0), of(1.0));
}

#[test]
fn a_circle_of_full_roads_lets_somebody_through() {
    let road = |index: u32| Road {
        from: index,
        to: (index + 1) % 3,
        length_m: 15.0,
        free_speed_m_per_s: 5.0,
        lanes: 1,
        capacity_veh_per_h: 1800.0,
        block: Some(index),
    };
    let map = RoadMap::new((0..3).map(road).collect(), vec![(0.0, 0.0); 3]).unwrap();
    let incidents = Incidents::none(3);
    let mut queues = Queues::new(&map, &incidents);
    for n in 0..6 {
        let start = n % 3;
        queues
            .depart(n, &[start, (start + 1) % 3, (start + 2) % 3])
            .unwrap();
    }
    let mut arrived = Vec::new();
    queues.advance(STUCK_S - 1.0, &mut arrived).unwrap();
    assert!(arrived.is_empty());
    queues.advance(10.0 * STUCK_S, &mut arrived).unwrap();
    assert_eq!(arrived.len(), 6);
    assert!(queues.let_through() > 0);
}

#[test]
fn whoever_sets_out_gives_way() {
    let map = chain(2, 600.0);
    let incidents = Incidents::none(2);
    let mut queues = Queues::new(&map, &incidents);
    for n in 0..100 {
        queues.depart(n, &[1]).unwrap();
    }
    for n in 100..110 {
        queues.depart(n, &[0, 1]).unwrap();
    }
    let mut arrived = Vec::new();
    queues.advance(300.0, &mut arrived).unwrap();
    let on_the_road = arrived.iter().filter(|arrival| arrival.vehicle >= 100).count();
    assert_eq!(on_the_road, 10, "{arrived:?}");
}

/// From road 0, which has so many lanes, on to road 1, which its only place makes full as soon as road 3 is closed, or to road 2.
fn fork(lanes: u32) -> RoadMap {
    let road = |from, to, length_m, lanes| Road {
        from,
        to,
        length_m,
        free_speed_m_per_s: 10.0,
        lanes,
        capacity_veh_per_h: 1800.0 * f64::from(lanes),
        block: Some(0),
    };
    let roads = vec![
        road(0, 1, 100.0, lanes),
        road(1, 2, 7.5, 1),
        road(1, 3, 100.0, 1),
        road(2, 4, 7.5, 1),
    ];
    RoadMap::new(roads, vec![(0.0, 0.0); 5]).unwrap()
}

/// The roads of a fork with road 1 full for ever, at 0 s.
fn blocked<'m>(map: &'m RoadMap, incidents: &'m Incidents) -> Queues<'m> {
    let mut queues = Queues::new(map, incidents);
    queues.depart(0, &[3]).unwrap();
    queues.roads[3].lanes[0].close();
    queues.depart(1, &[1, 3]).unwrap();
    queues
}

#[test]
fn who_waits_for_a_full_road_holds_up_one_lane() {
    let incidents = Incidents::none(1);
    for (lanes, passing) in [(1, 0), (2, 3)] {
        let map = fork(lanes);
        let mut queues = blocked(&map, &incidents);
        let mut arrived = Vec::new();
        queues.advance(1.0, &mut arrived).unwrap();
        // The lanes fill in turn: every other vehicle stands behind the one that waits.
        queues.depart(2, &[0, 1]).unwrap();
        for n in 3..8 {
            queues.depart(n, &[0, 2]).unwrap();
        }
        queues.advance(200.0, &mut arrived).unwrap();
        assert_eq!(arrived.len(), passing, "{lanes} lanes: {arrived:?}");
    }
}

#[test]
fn the_lane_with_the_fewest_vehicles_is_taken() {
    let incidents = Incidents::none(1);
    let map = fork(2);
    let mut queues = blocked(&map, &incidents);
    let mut arrived = Vec::new();
    queues.advance(1.0, &mut arrived).unwrap();
    queues.depart(2, &[0, 1]).unwrap();
    queues.advance(20.0, &mut arrived).unwrap();
    // One stands on the first lane: two more pass beside it, one after the other.
    for n in 3..5 {
        queues.depart(n, &[0, 2]).unwrap();
        queues.advance(20.0 * f64::from(n), &mut arrived).unwrap();
    }
    assert_eq!(arrived.len(), 2, "{arrived:?}");
}

#[test]
fn another_route_is_taken_also_while_waiting() {
    let map = fork(1);
    let incidents = Incidents::none(1);
    let mut queues = blocked(&map, &incidents);
    let mut arrived = Vec::new();
    queues.depart(2, &[0, 1]).unwrap();
    queues.advance(50.0, &mut arrived).unwrap();
    assert!(arrived.is_empty());
    queues.take_route(2, &[2]).unwrap();
    queues.advance(61.0, &mut arrived).unwrap();
    assert_eq!(
        arrived,
        [Arrival {
            vehicle: 2,
            time_s: 60.0
        }]
    );
}
