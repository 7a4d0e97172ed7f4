//! A comparison on the screen.

use std::fmt::Write as _;

use crate::report::chart::{decimals_of, signed};
use crate::report::values::{figure, interval, p_value, percent};
use crate::verify::judgement::comparison::Comparison;

/// What a terminal shows.
pub(crate) fn text(comparison: &Comparison, zeros: &[String]) -> String {
    let mut text = format!("{}\n{}", comparison.headline(), comparison.reason.line());
    for words in &comparison.words {
        let _ = writeln!(text, "  - {words}");
    }
    if let Some(surface) = &comparison.surface {
        let _ = writeln!(
            text,
            "surface   as driven {}, recorded {} of what can be seen from the path ({} of all)",
            percent(surface.as_driven.of_observable),
            percent(surface.recorded.of_observable),
            percent(Some(surface.observable_share)),
        );
    }
    let counts = &comparison.coverage;
    let _ = writeln!(
        text,
        "cells     planned {}, as driven {}, recorded {}",
        counts.planned, counts.as_driven, counts.recorded
    );
    if let Some(agreement) = &comparison.agreement {
        let _ = writeln!(
            text,
            "patches   IoU {}{}, kappa {}, p {}",
            figure(agreement.patches.agreement.iou),
            interval(agreement.patches.iou_interval),
            figure(agreement.patches.agreement.kappa),
            agreement.p_value.map_or("-".into(), |p| format!("{p:.3}"))
        );
    }
    for (sensor, rays) in &comparison.rays {
        let classes = &rays.classes;
        let _ = writeln!(
            text,
            "{sensor:9} {} of {} rays agree; short {}, long {}, drop {}, extra {}",
            percent(rays.agree_share),
            classes.informative(),
            classes.short,
            classes.long,
            classes.drop,
            classes.extra
        );
    }
    if let Some(conflicts) = &comparison.conflicts {
        let _ = writeln!(
            text,
            "cells of {} m: {} occupied in both, {} looked through, {} hit where the scene is empty, {} known to one alone",
            conflicts.cell_m,
            conflicts.agree,
            conflicts.gone.cells,
            conflicts.unforeseen.cells,
            conflicts.unknown
        );
    }
    for row in tilt_rows(comparison) {
        let _ = writeln!(text, "pitch     {}", row.join("  "));
    }
    for zero in zeros {
        let _ = writeln!(text, "zero      {zero}");
    }
    text
}

/// How well the beam angles of a good sensor are known, degrees (data sheets of the Ouster OS1).
const BEAMS_DEG: f64 = 0.01;

pub(super) fn tilt_rows(comparison: &Comparison) -> Vec<Vec<String>> {
    let degrees = |value: f64, u95: f64| {
        let digits = decimals_of(u95);
        format!("{} ± {u95:.digits$}°", signed(value, digits))
    };
    let mut rows: Vec<Vec<String>> = Vec::new();
    for check in &comparison.mount {
        let tilt = check.tilt_error_deg.zip(check.u95_deg);
        rows.push(vec![
            check.sensor.clone(),
            tilt.map_or("cannot tell here".into(), |(value, u95)| degrees(value, u95)),
            check.p_value.map_or("-".into(), p_value),
            format!(
                "observable: {}",
                if check.observable.is_empty() { "nothing".into() } else { check.observable.join(" ") }
            ),
            check.condition_number.map_or("condition -".into(), |value| format!("condition {value:.1}")),
        ]);
    }
    if let Some(relative) = &comparison.relative_tilt {
        rows.push(vec![
            relative.sensors.join(" - "),
            degrees(relative.error_deg, relative.u95_deg),
            p_value(relative.p_value),
            match relative.error_deg.abs() + relative.u95_deg < BEAMS_DEG {
                true => "less than beams are calibrated to".into(),
                false => String::new(),
            },
            String::new(),
        ]);
    }
    rows
}
