// Drives a unicycle with the exported Nav2 controller past a person and a wall, and writes a row per
// tick: seconds, place on the map, command, place of the person. Then what goes wrong, in words.
#include <cmath>
#include <cstdio>

#include "nav2_stub.hpp"

namespace
{
constexpr double TICK = 0.05, YAW = 0.3, AT[2] = {1.0, 2.0}; // of odom on the map

struct World
{
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>();
  std::shared_ptr<tf2_ros::Buffer> tf = std::make_shared<tf2_ros::Buffer>();
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap =
    std::make_shared<nav2_costmap_2d::Costmap2DROS>();
  std::unique_ptr<nav2_core::Controller> controller =
    pluginlib::known().at("wideberth_nav2::Controller")();
  double x = 0.0, y = 0.0, heading = 0.0;  // in odom, whose x axis the path follows
  geometry_msgs::msg::Twist moving;
};

geometry_msgs::msg::Quaternion turned(double yaw)
{
  return {0.0, 0.0, std::sin(0.5 * yaw), std::cos(0.5 * yaw)};
}

void build(World & world)
{
  // of the map in odom: the inverse of where odom is on the map
  const double c = std::cos(YAW), s = std::sin(YAW);
  auto & placed = world.tf->known["odom map"].transform;
  placed.translation = {-c * AT[0] - s * AT[1], s * AT[0] - c * AT[1], 0.0};
  placed.rotation = turned(-YAW);
  auto & map = world.costmap->map;
  map.width = 140, map.height = 80, map.x = -2.0, map.y = -4.0;
  map.cells.assign(140 * 80, 0);
  for (unsigned int row = 20; row < 30; row++) { // 1 m to the right of the path
    for (unsigned int column = 60; column < 75; column++) {map.cells[row * 140 + column] = 254;}
  }
  world.node->parameters["FollowPath.obstacles"] = std::string(KIND);
  world.controller->configure(world.node, "FollowPath", world.tf, world.costmap);
  world.controller->activate();
}

void follow(World & world)
{
  nav_msgs::msg::Path path;
  path.header.frame_id = "map";
  for (double along = 0.0; along < 10.001; along += 0.05) {
    geometry_msgs::msg::PoseStamped pose;
    pose.pose.position = {AT[0] + std::cos(YAW) * along, AT[1] + std::sin(YAW) * along, 0.0};
    path.poses.push_back(pose);
  }
#if __has_include("nav2_ros_common/lifecycle_node.hpp")
  world.controller->newPathReceived(path);
#else
  world.controller->setPlan(path);
#endif
}

void see(World & world, double px, double py, double stamp)
{
#ifdef OF_COSTMAP_CONVERTER
  costmap_converter_msgs::msg::ObstacleArrayMsg message;
  costmap_converter_msgs::msg::ObstacleMsg one;
  one.polygon.points.push_back({static_cast<float>(px), static_cast<float>(py), 0.0F});
  one.radius = 0.3, one.id = 7;
#else
  nav2_dynamic_msgs::msg::ObstacleArray message;
  nav2_dynamic_msgs::msg::Obstacle one;
  one.position = {px, py, 0.0}, one.size = {0.6, 0.5, 1.8}, one.uuid.uuid[3] = 200;
  one.position_covariance[0] = one.position_covariance[4] = 4e-4;
#endif
  message.header.frame_id = "odom", message.header.stamp = rclcpp::Time(stamp);
  message.obstacles.push_back(one);
  world.node->callback(&message);
}

geometry_msgs::msg::Twist asked(World & world)
{
  geometry_msgs::msg::PoseStamped pose;
  pose.header.frame_id = "odom", pose.header.stamp = world.node->clock->now();
  pose.pose.position = {world.x, world.y, 0.0}, pose.pose.orientation = turned(world.heading);
#if __has_include("nav2_ros_common/lifecycle_node.hpp")
  return world.controller->computeVelocityCommands(pose, world.moving, nullptr, {}, {}).twist;
#else
  return world.controller->computeVelocityCommands(pose, world.moving, nullptr).twist;
#endif
}

void fails(World & world, const char * words)
{
  try {
    asked(world);
    std::printf("%s: nothing was thrown\n", words);
  } catch (const nav2_core::ControllerException & error) {
    std::printf("%s: %s\n", words, error.what());
  }
}
}  // namespace

int main()
{
  World world;
  build(world);
  double & now = world.node->clock->seconds;
  fails(world, "no path");
  follow(world);
  fails(world, "no obstacles");
  for (int k = 0; k < 1000; k++, now += TICK) {
    const double px = 4.5, py = 2.5 - 0.25 * now; // walks across the path
    if (k % 2 == 0) {see(world, px, py, now);}
    if (k == 400 || k == 500) {world.controller->setSpeedLimit(k == 400 ? 40.0 : 0.0, true);}
    world.moving = asked(world);
    world.heading += TICK * world.moving.angular.z;
    world.x += TICK * world.moving.linear.x * std::cos(world.heading);
    world.y += TICK * world.moving.linear.x * std::sin(world.heading);
    std::printf(
      "%.3f %.9f %.9f %.9f %.9f %.9f %.9f\n", now, world.x, world.y, world.moving.linear.x,
      world.moving.angular.z, px, py);
  }
  now += 2.0;
  fails(world, "late");
  see(world, 4.5, 0.0, now);
  world.tf->known.clear();
  now += 0.1;
  fails(world, "no frame");
  return 0;
}
