//! URDF: links that hang in each other by joints, each joint at its zero but where the file says its position.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3, EulerRot};
use roxmltree::{Document, Node};

use super::super::NamedFrame;
use super::{Extrinsics, Known};
use crate::base::geometry::Pose;

pub(super) fn parse(text: &str) -> Result<Extrinsics, String> {
    let document = Document::parse(text).map_err(|error| format!("no XML: {error}"))?;
    let robot = document.root_element();
    if robot.tag_name().name() != "robot" {
        return Err(format!("the root element is <{}>, expected <robot> of URDF", robot.tag_name().name()));
    }
    if let Some(macro_node) =
        robot.descendants().find(|node| node.tag_name().namespace().is_some_and(|of| of.contains("xacro")))
    {
        return Err(format!(
            "{}: <xacro:{}> is not worked out yet: `xacro FILE > rig.urdf` does that",
            line_of(macro_node),
            macro_node.tag_name().name()
        ));
    }
    let own: Vec<Node<'_, '_>> = robot.children().filter(|node| node.has_tag_name("outrigger")).collect();
    let mut positions = BTreeMap::new();
    let mut found = Extrinsics::default();
    for node in &own {
        let frame = needed(*node, "frame")?;
        let of = |name: &str| node.attribute(name).map(str::to_owned);
        found.known.insert(frame.into(), Known { name: of("name"), model: of("model"), calibration: None });
        if let Some(joint) = node.attribute("joint") {
            positions.insert(joint, number(*node, "position", needed(*node, "position")?)?);
        }
    }
    for joint in robot.children().filter(|node| node.has_tag_name("joint")) {
        link(joint, &positions, &mut found)?;
    }
    if found.links.is_empty() {
        return Err("has no joint: expected links that hang from a base by joints".into());
    }
    Ok(found)
}

fn link(joint: Node<'_, '_>, positions: &BTreeMap<&str, f64>, found: &mut Extrinsics) -> Result<(), String> {
    let name = needed(joint, "name")?;
    let end = |which: &str| {
        let node = child(joint, which)
            .ok_or_else(|| format!("{}: joint {name:?} has no <{which}>", line_of(joint)))?;
        needed(node, "link").map(str::to_owned)
    };
    let (parent, frame) = (end("parent")?, end("child")?);
    let zero = origin(joint)?;
    let position = positions.get(name).copied();
    let moved = match needed(joint, "type")? {
        "fixed" => Pose::IDENTITY,
        "revolute" | "continuous" => {
            if position.is_none() {
                found
                    .notices
                    .push(format!("joint {name} stands at its zero: the file does not say its position"));
            }
            Pose::new(DQuat::from_axis_angle(axis(joint)?, position.unwrap_or(0.0)), DVec3::ZERO)
        }
        "prismatic" => {
            if position.is_none() {
                found
                    .notices
                    .push(format!("joint {name} stands at its zero: the file does not say its position"));
            }
            Pose::new(DQuat::IDENTITY, axis(joint)? * position.unwrap_or(0.0))
        }
        other => {
            return Err(format!(
                "{}: joint {name:?} is {other:?}, expected fixed, revolute, continuous or prismatic",
                line_of(joint)
            ));
        }
    };
    found.links.push(NamedFrame { name: frame, parent, parent_from_frame: zero * moved });
    Ok(())
}

fn origin(joint: Node<'_, '_>) -> Result<Pose, String> {
    let Some(node) = child(joint, "origin") else { return Ok(Pose::IDENTITY) };
    let translation_m = vector(node, "xyz")?.unwrap_or(DVec3::ZERO);
    let angles = vector(node, "rpy")?.unwrap_or(DVec3::ZERO);
    // fixed axes: Rz(yaw) Ry(pitch) Rx(roll)
    Ok(Pose::new(DQuat::from_euler(EulerRot::ZYX, angles.z, angles.y, angles.x), translation_m))
}

/// Unit vector of the joint's axis; x where it says none.
fn axis(joint: Node<'_, '_>) -> Result<DVec3, String> {
    let Some(node) = child(joint, "axis") else { return Ok(DVec3::X) };
    let axis = vector(node, "xyz")?.unwrap_or(DVec3::X);
    axis.try_normalize().ok_or_else(|| format!("{}: the axis {axis} has no direction", line_of(node)))
}

fn vector(node: Node<'_, '_>, attribute: &str) -> Result<Option<DVec3>, String> {
    let Some(text) = node.attribute(attribute) else { return Ok(None) };
    let numbers: Vec<f64> =
        text.split_whitespace().map(|word| number(node, attribute, word)).collect::<Result<_, _>>()?;
    match numbers[..] {
        [x, y, z] => Ok(Some(DVec3::new(x, y, z))),
        _ => Err(format!("{}: {attribute} is {text:?}, expected three numbers", line_of(node))),
    }
}

fn number(node: Node<'_, '_>, attribute: &str, word: &str) -> Result<f64, String> {
    let number = word.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("{}: {attribute} has {word:?}, expected a finite number", line_of(node)))
}

fn needed<'a>(node: Node<'a, '_>, attribute: &str) -> Result<&'a str, String> {
    node.attribute(attribute)
        .ok_or_else(|| format!("{}: <{}> has no {attribute}", line_of(node), node.tag_name().name()))
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.has_tag_name(name))
}

fn line_of(node: Node<'_, '_>) -> String {
    format!("line {}", node.document().text_pos_at(node.range().start).row)
}
