//! Places where bodies deform: the choice by measured times, and that measuring leaves a body as it was.

use super::*;
use crate::display::bodies::GpuBodies;
use crate::world::tests::world;

#[test]
fn the_faster_is_taken_and_both_times_are_told() {
    let device = Choice::by_time(1.2e-3, 3.1e-4);
    assert!(device.on_device);
    assert_eq!(device.describe(), "deforms on the graphics device: CPU 1.20 ms with upload, device 310.0 µs");
    assert_eq!(device.brief(), "deforms on device 0.31 ms, CPU 1.20 ms");
    assert_eq!(
        device.json(),
        json!({ "on": "device", "why": "measured", "cpu_s": 1.2e-3, "device_s": 3.1e-4 })
    );
    let cpu = Choice::by_time(4e-4, 2.5e-2);
    assert!(!cpu.on_device && !Choice::by_time(1e-3, 1e-3).on_device);
    assert_eq!(cpu.brief(), "deforms on CPU 0.40 ms, device 25.0 ms");
}

/// The overlay has 40 letters a row.
#[test]
fn every_choice_fits_into_the_overlay() {
    let choices = [
        Choice { on_device: false, why: Why::Asked },
        Choice { on_device: true, why: Why::Asked },
        Choice { on_device: false, why: Why::Software },
        Choice { on_device: false, why: Why::TooLarge },
        Choice::by_time(9.994e-3, 99.94e-3),
        Choice::by_time(99.94e-3, 9.994e-3),
        Choice::by_time(1.2345, 0.1),
    ];
    for choice in choices {
        assert!(choice.brief().chars().count() <= 40, "{}", choice.brief());
    }
    let [cpu, device] = [false, true].map(|on_device| Choice { on_device, why: Why::Asked });
    assert_eq!(brief(&[cpu, device, cpu]), "bodies deform: 1 on device, 2 on CPU");
    assert_eq!((brief(&[cpu; 3]), brief(&[])), ("3 bodies deform on CPU".into(), String::new()));
}

/// A software device that passes for another works too: both ways are timed, and the body is at rest wherever it deforms.
#[test]
fn auto_measures_chooses_by_what_it_measured_and_leaves_the_body_at_rest() {
    let mut gpu = match Gpu::headless() {
        Ok(gpu) => gpu,
        Err(error @ RenderError::NoAdapter(_)) => {
            assert!(std::env::var("GREENSTAGE_REQUIRE_GPU").as_deref() != Ok("1"), "{error}");
            return eprintln!("SKIPPED: {error}");
        }
        Err(error) => panic!("{error}"),
    };
    let mut world = world();
    let fixed = |gpu: &Gpu, world: &mut crate::world::World, deform| {
        let asked = Args { deform, ..Args::default() };
        GpuBodies::new(gpu, world, asked).unwrap().choices
    };
    gpu.is_software = true;
    assert_eq!(fixed(&gpu, &mut world, DeformOn::Auto), [Choice { on_device: false, why: Why::Software }]);
    gpu.is_software = false;
    let bodies = GpuBodies::new(&gpu, &mut world, Args::default()).unwrap();
    let [choice] = bodies.choices[..] else { panic!("{:?}", bodies.choices) };
    let Why::Measured { cpu_s, device_s } = choice.why else { panic!("{choice:?}") };
    println!("{}", choice.describe());
    assert!(cpu_s > 0.0 && device_s > 0.0 && cpu_s < 60.0 && device_s < 60.0, "{choice:?}");
    assert_eq!(choice, Choice::by_time(cpu_s, device_s));
    assert_eq!(bodies.deformation(), choice.brief());
    let deformer = &world.bodies[0].deformer;
    assert_eq!(*deformer.positions(), *deformer.rest(), "it stands at rest again");

    let limit = std::mem::replace(&mut gpu.storage_limit, 256);
    assert_eq!(fixed(&gpu, &mut world, DeformOn::Auto), [Choice { on_device: false, why: Why::TooLarge }]);
    gpu.storage_limit = limit;
    for (deform, on_device) in [(DeformOn::Cpu, false), (DeformOn::Gpu, true)] {
        assert_eq!(fixed(&gpu, &mut world, deform), [Choice { on_device, why: Why::Asked }]);
    }
}
