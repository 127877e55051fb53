//! `greenstage bench --sizes`: frames by the size of the model, with bodies deformed on the CPU and on the device.

use super::print::print;
use crate::base::columns::Storage;
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::table::{Table, bytes, seconds};
use crate::display::device::{self, DeformOn};
use crate::green::FIELDS;
use crate::render::{COLOR_FORMAT, Gpu, Renderer};
use crate::stage::Stage;
use crate::verify::frame_sizes::{self, ELEMENTS, Row};
use serde_json::{Value, json};

/// Settings and devices that all rows have in common.
struct Header<'a> {
    stage: &'a Stage,
    storage: Storage,
    device: String,
    has_clock: bool,
    one_pass: bool,
    /// Bytes of depth and samples, and if every target had its own.
    attachments: [u64; 2],
}

/// Measures all sizes, where the bodies may deform, and prints a table, or the same as JSON.
pub fn run(
    sizes: &[usize],
    (storage, frames): (Storage, usize),
    device: device::Args,
    stage: &Stage,
    json: bool,
) -> Result<(), Failure> {
    let mut gpu = Gpu::headless()?;
    let has_clock = gpu.start_clock()?;
    let mut renderer = Renderer::new(&gpu, COLOR_FORMAT, 4)?;
    device.apply(&gpu, &mut renderer)?;
    let on_device: &[bool] = match device.deform {
        DeformOn::Auto => &[false, true],
        DeformOn::Cpu => &[false],
        DeformOn::Gpu => &[true],
    };
    let request = frame_sizes::Request { sizes, storage, frames, on_device, stage };
    let (rows, attachments) = frame_sizes::measure(&gpu, &mut renderer, &request)?;
    let header = Header {
        stage,
        storage,
        device: gpu.describe(),
        has_clock,
        one_pass: renderer.multiview,
        attachments,
    };
    if json { print(&format!("{:#}\n", as_json(&header, &rows))) } else { print(&as_text(&header, &rows)) }
}

fn as_text(header: &Header<'_>, rows: &[Row]) -> String {
    let heading = [
        "nodes",
        "deformed on",
        "deform",
        "normals",
        "upload",
        "draw",
        "frame",
        "frames/s",
        "drawn",
        "culled",
        "buffers",
    ];
    let mut table = Table::new(&heading);
    for Row { nodes, on_device, parts, frame_s, counts, buffer_bytes } in rows {
        table.row(&[
            &nodes.to_string(),
            if *on_device { "device" } else { "CPU" },
            &seconds(parts.deform_s),
            &seconds(parts.normals_s),
            &seconds(parts.upload_s),
            &seconds(parts.draw_s),
            &seconds(*frame_s),
            &format!("{:.1}", 1.0 / frame_s),
            &counts.drawn.to_string(),
            &counts.culled.to_string(),
            &bytes(*buffer_bytes as f64),
        ]);
    }
    let Header { stage, storage, device, has_clock, one_pass, attachments: [shared, alone] } = header;
    let passes = if *one_pass { "one pass for both eyes" } else { "a pass for each eye" };
    let clock = if *has_clock { "times on the device by its own clock" } else { "the device has no clock" };
    format!(
        "{}, {} pictures, {passes}, {} columns of {storage:?}, on {device}; {clock}\ndepth and samples: {}, {} if \
         every target had its own\n\n{}\n",
        stage.name,
        2 * stage.screens.len(),
        ELEMENTS * FIELDS,
        bytes(*shared as f64),
        bytes(*alone as f64),
        table.text()
    )
}

fn as_json(header: &Header<'_>, rows: &[Row]) -> Value {
    let Header { stage, storage, device, has_clock, one_pass, attachments: [shared, alone] } = header;
    let row = |row: &Row| {
        let Row { nodes, on_device, parts, frame_s, counts, buffer_bytes } = row;
        json!({ "nodes": nodes, "deformed_on": if *on_device { "device" } else { "cpu" },
            "steps_s": { "deform": parts.deform_s, "normals": parts.normals_s, "upload": parts.upload_s,
                "draw": parts.draw_s },
            "frame_s": frame_s, "frames_per_s": 1.0 / frame_s, "shapes_drawn": counts.drawn,
            "shapes_culled": counts.culled, "passes": counts.passes, "buffer_bytes": buffer_bytes })
    };
    json!({ "stage": stage.name, "pictures": 2 * stage.screens.len(), "one_pass_for_both_eyes": one_pass,
        "columns": ELEMENTS * FIELDS, "storage": storage, "device": device, "device_has_clock": has_clock,
        "attachment_bytes": shared, "attachment_bytes_unshared": alone, "processor": machine::processor(),
        "version": env!("CARGO_PKG_VERSION"), "sizes": rows.iter().map(row).collect::<Vec<_>>() })
}
