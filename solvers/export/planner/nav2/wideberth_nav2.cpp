// A controller of Nav2 around the exported planner, for Jazzy, Kilted and Lyrical.
//
// It takes the robot's pose and velocity from the controller server, obstacles from a topic, and
// walls from the lethal cells of the local costmap. The planner decides every WIDEBERTH_PLAN_PERIOD
// seconds; in between the command goes on along the ramp that the planner asks for.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "nav2_core/controller.hpp"
#include "nav2_core/controller_exceptions.hpp"
#include "nav_msgs/msg/path.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
#include "nav2_dynamic_msgs/msg/obstacle_array.hpp"
#endif
#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
#include "costmap_converter_msgs/msg/obstacle_array_msg.hpp"
#endif

#include "wideberth_planner.h"

#if __has_include("nav2_ros_common/lifecycle_node.hpp")
#define WIDEBERTH_LYRICAL 1 // the signatures of nav2_core::Controller since Lyrical
#endif

namespace wideberth_nav2
{

#ifdef WIDEBERTH_LYRICAL
using Node = nav2::LifecycleNode;
#else
using Node = rclcpp_lifecycle::LifecycleNode;
#endif

static_assert(
  WIDEBERTH_PLAN_STATES == 5 && WIDEBERTH_STATE_X == 0 && WIDEBERTH_STATE_Y == 1 &&
  WIDEBERTH_STATE_PHI == 2 && WIDEBERTH_STATE_V == 3 && WIDEBERTH_STATE_OMEGA == 4,
  "Nav2 gives pose, forward speed and yaw rate: export the planner of a unicycle");

/// Where one frame lies in another, in the plane.
struct Placement
{
  double x = 0.0, y = 0.0, cosine = 1.0, sine = 0.0;

  void move(double * place) const
  {
    const double here[2] = {place[0], place[1]};
    place[0] = x + cosine * here[0] - sine * here[1];
    place[1] = y + sine * here[0] + cosine * here[1];
  }

  /// Turn a covariance, row by row.
  void turn(double * covariance) const
  {
    const double a = covariance[0], b = 0.5 * (covariance[1] + covariance[2]), c = covariance[3];
    covariance[0] = cosine * cosine * a - 2.0 * cosine * sine * b + sine * sine * c;
    covariance[3] = sine * sine * a + 2.0 * cosine * sine * b + cosine * cosine * c;
    covariance[1] = cosine * sine * (a - c) + (cosine * cosine - sine * sine) * b;
    covariance[2] = covariance[1];
  }
};

template<class Quaternion>
double yaw_of(const Quaternion & turn)
{
  return std::atan2(
    2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z));
}

class Controller : public nav2_core::Controller
{
public:
  void configure(
    const Node::WeakPtr & parent, std::string name, std::shared_ptr<tf2_ros::Buffer> tf,
    std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap) override
  {
    const auto node = parent.lock();
    if (!node) {
      throw nav2_core::ControllerException("the controller server's node is gone");
    }
    clock_ = node->get_clock();
    logger_ = node->get_logger();
    tf_ = tf, costmap_ = costmap;
    read_parameters(*node, name);
    memory_.resize(wideberth_planner_size() / sizeof(double) + 1);
    const int status =
      wideberth_planner_begin(memory_.data(), memory_.size() * sizeof(double), &planner_);
    if (status != WIDEBERTH_PLANNED) {
      throw nav2_core::ControllerException(wideberth_planner_status_text(status));
    }
    subscribe(node);
  }

  void cleanup() override
  {
    subscription_.reset();
    planner_ = nullptr;
    memory_.clear();
  }

  void activate() override {stand();}
  void deactivate() override {stand();}

  void setSpeedLimit(const double & limit, const bool & percentage) override
  {
    const double stated = percentage ? 0.01 * limit * WIDEBERTH_PLAN_MAX_SPEED : limit;
    fastest_ = limit > 0.0 ? stated : INFINITY; // 0 means no limit
  }

  /// The task is over; what is known of obstacles stays.
  void reset() override {stand();}

#ifdef WIDEBERTH_LYRICAL
  void newPathReceived(const nav_msgs::msg::Path & path) override {follow(path);}

  geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    nav2_core::GoalChecker *, const nav_msgs::msg::Path &,
    const geometry_msgs::msg::PoseStamped &) override
  {
    return command(pose, velocity);
  }
#else
  void setPlan(const nav_msgs::msg::Path & path) override {follow(path);}

  geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    nav2_core::GoalChecker *) override
  {
    return command(pose, velocity);
  }
#endif

private:
  using Detections = std::vector<wideberth_detection>;

  /// Obstacles of the newest message, in its frame.
  struct Received
  {
    std::string frame;
    double stamp = -INFINITY;
    Detections people;
  };

  template<class T>
  T parameter(Node & node, const std::string & name, const T & usual, const char * words)
  {
    if (!node.has_parameter(name)) {
      rcl_interfaces::msg::ParameterDescriptor described;
      described.description = words;
      described.read_only = true;
      node.declare_parameter(name, rclcpp::ParameterValue(usual), described);
    }
    return node.get_parameter(name).get_value<T>();
  }

  void read_parameters(Node & node, const std::string & name)
  {
    kind_ = parameter<std::string>(
      node, name + ".obstacles", "nav2_dynamic_msgs",
      "messages of obstacles: nav2_dynamic_msgs, costmap_converter_msgs, or none");
    topic_ = parameter<std::string>(node, name + ".obstacles_topic", "obstacles", "their topic");
    timeout_ = parameter(
      node, name + ".obstacles_timeout", 1.0, "s after which obstacles are late: the robot stops");
    radius_ = parameter(
      node, name + ".obstacle_radius", 0.3, "m, of obstacles whose size is not stated");
    deviation_ = parameter(
      node, name + ".obstacle_deviation", 0.05,
      "m per axis, of places whose covariance is not stated");
    walls_ = parameter(
      node, name + ".walls", true, "whether lethal cells of the local costmap are walls");
    around_ = parameter(
      node, name + ".clear_around", 0.3,
      "m around obstacles in which cells are no walls: they are the obstacles themselves");
    tick_ = 1.0 / parameter(node, "controller_frequency", 20.0, "Hz, of the controller server");
  }

  void subscribe(const std::shared_ptr<Node> & node)
  {
#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
    if (kind_ == "nav2_dynamic_msgs") {
      using Message = nav2_dynamic_msgs::msg::ObstacleArray;
      subscription_ = rclcpp::create_subscription<Message>(
        node, topic_, rclcpp::SensorDataQoS(),
        [this](const Message & message) {take(message.header, people_of(message));});
      return;
    }
#endif
#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
    if (kind_ == "costmap_converter_msgs") {
      using Message = costmap_converter_msgs::msg::ObstacleArrayMsg;
      subscription_ = rclcpp::create_subscription<Message>(
        node, topic_, rclcpp::SensorDataQoS(),
        [this](const Message & message) {take(message.header, people_of(message));});
      return;
    }
#endif
    if (kind_ != "none") {
      throw nav2_core::ControllerException(
              "obstacles is " + kind_ + ", which this package was not built with; wanted "
              "nav2_dynamic_msgs, costmap_converter_msgs, or none");
    }
  }

  template<class Header>
  void take(const Header & header, Detections && people)
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    received_.frame = header.frame_id;
    received_.stamp = rclcpp::Time(header.stamp).seconds();
    received_.people = std::move(people);
  }

  wideberth_detection detection(const std::string & name, double x, double y, double radius) const
  {
    wideberth_detection one{};
    name.copy(one.name, WIDEBERTH_NAME - 1);
    one.position[0] = x, one.position[1] = y;
    one.covariance[0] = one.covariance[3] = deviation_ * deviation_;
    one.radius = radius > 0.0 ? radius : radius_;
    return one;
  }

#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
  Detections people_of(const nav2_dynamic_msgs::msg::ObstacleArray & message) const
  {
    Detections found;
    for (const auto & one : message.obstacles) {
      std::string name;
      for (const auto byte : one.uuid.uuid) {
        name += "0123456789abcdef"[byte >> 4], name += "0123456789abcdef"[byte & 15];
      }
      found.push_back(
        detection(name, one.position.x, one.position.y, 0.5 * std::max(one.size.x, one.size.y)));
      const auto & spread = one.position_covariance;
      if (spread[0] > 0.0 && spread[4] > 0.0) {
        const double stated[4] = {spread[0], spread[1], spread[3], spread[4]};
        std::copy(stated, stated + 4, found.back().covariance);
      }
    }
    return found;
  }
#endif

#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
  Detections people_of(const costmap_converter_msgs::msg::ObstacleArrayMsg & message) const
  {
    Detections found;
    for (const auto & one : message.obstacles) {
      const double count = static_cast<double>(one.polygon.points.size());
      double x = 0.0, y = 0.0, reach = 0.0;
      for (const auto & point : one.polygon.points) {
        x += point.x / count, y += point.y / count;
      }
      for (const auto & point : one.polygon.points) {
        reach = std::max(reach, std::hypot(point.x - x, point.y - y));
      }
      if (count > 0.0) {
        found.push_back(detection(std::to_string(one.id), x, y, reach + one.radius));
      }
    }
    return found;
  }
#endif

  /// Where a frame lies in another now.
  Placement placed(const std::string & frame, const std::string & in) const
  {
    Placement found;
    if (frame == in || frame.empty()) {
      return found;
    }
    try {
      const auto stamped = tf_->lookupTransform(in, frame, tf2::TimePointZero);
      const double yaw = yaw_of(stamped.transform.rotation);
      found.x = stamped.transform.translation.x, found.y = stamped.transform.translation.y;
      found.cosine = std::cos(yaw), found.sine = std::sin(yaw);
    } catch (const tf2::TransformException & error) {
      throw nav2_core::ControllerTFError(error.what());
    }
    return found;
  }

  void follow(const nav_msgs::msg::Path & path)
  {
    if (path.poses.size() < 2) {
      throw nav2_core::InvalidPath("the path has fewer than two poses");
    }
    path_ = path;
    new_path_ = true;
  }

  /// Hand the path to the planner, in the frame of the pose.
  void lay(const std::string & frame)
  {
    const Placement placement = placed(path_.header.frame_id, frame);
    const size_t all = path_.poses.size(), stride = (all - 1) / (WIDEBERTH_PATH_POINTS - 1) + 1;
    std::vector<double> points;
    for (size_t k = 0; k < all; k += stride) {
      const auto & place = path_.poses[k + stride < all ? k : all - 1].pose.position;
      points.insert(points.end(), {place.x, place.y});
      placement.move(&points[points.size() - 2]);
    }
    const auto * given = reinterpret_cast<const double(*)[2]>(points.data());
    const int count = static_cast<int>(points.size() / 2);
    const int status = new_path_ ? wideberth_planner_set_path(planner_, given, count) :
      wideberth_planner_move_path(planner_, given, count);
    if (status != WIDEBERTH_PLANNED) {
      throw nav2_core::InvalidPath(wideberth_planner_status_text(status));
    }
    new_path_ = false;
  }

  /// Obstacles of the newest message in a frame; late ones are an error.
  Detections people(const std::string & frame, double now)
  {
    if (kind_ == "none") {
      return {};
    }
    Received received;
    {
      const std::lock_guard<std::mutex> guard(mutex_);
      received = received_;
    }
    if (!(now - received.stamp <= timeout_)) {
      throw nav2_core::ControllerException("no obstacles on " + topic_ + " of late");
    }
    const Placement placement = placed(received.frame, frame);
    for (auto & one : received.people) {
      one.age = std::max(now - received.stamp, 0.0);
      placement.move(one.position);
      placement.turn(one.covariance);
    }
    return received.people;
  }

  /// Lethal cells of the costmap that are not of the obstacles, as rectangles near the robot.
  std::vector<wideberth_polygon> walls(const double * state, const Detections & people)
  {
    std::vector<wideberth_polygon> found(WIDEBERTH_WALLS);
    if (!walls_ || found.empty()) {
      return {};
    }
    auto * map = costmap_->getCostmap();
    const std::lock_guard<nav2_costmap_2d::Costmap2D::mutex_t> guard(*map->getMutex());
    const int width = static_cast<int>(map->getSizeInCellsX());
    const int height = static_cast<int>(map->getSizeInCellsY());
    const double size = map->getResolution();
    cells_.assign(map->getCharMap(), map->getCharMap() + static_cast<size_t>(width) * height);
    taken_.resize(cells_.size());
    for (const auto & one : people) {
      const double room = one.radius + around_;
      for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
          const double off = map->getOriginX() + (x + 0.5) * size - one.position[0];
          const double away = map->getOriginY() + (y + 0.5) * size - one.position[1];
          if (off * off + away * away < room * room) {
            cells_[static_cast<size_t>(y) * width + x] = 0;
          }
        }
      }
    }
    const wideberth_costmap given = {
      cells_.data(), width, height, size, {map->getOriginX(), map->getOriginY()}, 254, 255};
    const int count = wideberth_walls_of(&given, state, taken_.data(), found.data(), WIDEBERTH_WALLS);
    found.resize(static_cast<size_t>(std::clamp(count, 0, WIDEBERTH_WALLS)));
    return found;
  }

  void decide(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    double now)
  {
    const std::string & frame = pose.header.frame_id;
    const double state[WIDEBERTH_PLAN_STATES] = {
      pose.pose.position.x, pose.pose.position.y, yaw_of(pose.pose.orientation),
      velocity.linear.x, velocity.angular.z};
    lay(frame);
    Detections seen = people(frame, now);
    if (seen.size() > WIDEBERTH_DETECTIONS) {
      const auto nearer = [&state](const wideberth_detection & one, const wideberth_detection & two) {
          return std::hypot(one.position[0] - state[0], one.position[1] - state[1]) <
                 std::hypot(two.position[0] - state[0], two.position[1] - state[1]);
        };
      std::nth_element(seen.begin(), seen.begin() + WIDEBERTH_DETECTIONS, seen.end(), nearer);
      seen.resize(WIDEBERTH_DETECTIONS);
    }
    const auto still = walls(state, seen);
    const wideberth_observation observation = {
      now, state, static_cast<int>(seen.size()), seen.data(), static_cast<int>(still.size()),
      still.data()};
    const int status = wideberth_planner_decide(planner_, &observation, &decision_);
    if (status != WIDEBERTH_PLANNED) {
      throw nav2_core::NoValidControl(decision_.reason);
    }
    std::copy(put_out_, put_out_ + 3, begin_);
    decided_ = now;
    if (decision_.rung != WIDEBERTH_OPTIMAL) {
      RCLCPP_WARN_THROTTLE(logger_, *clock_, 10000, "%s", decision_.reason);
    }
  }

  /// The command a tick from now, on the ramp from the one that was put out last.
  geometry_msgs::msg::TwistStamped command(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity)
  {
    const double now = clock_->now().seconds();
    if (path_.poses.empty()) {
      throw nav2_core::InvalidPath("no path is set");
    }
    if (new_path_ || now < decided_ || now - decided_ >= WIDEBERTH_PLAN_PERIOD - 0.5 * tick_) {
      try {
        decide(pose, velocity, now);
      } catch (...) {
        stand(); // as the controller server does now
        throw;
      }
    }
    const auto & wanted = decision_.command;
    const double target[3] = {wanted.linear[0], wanted.linear[1], wanted.omega};
    const double way = wanted.ramp > 0.0 ?
      std::min((now + tick_ - decided_) / wanted.ramp, 1.0) : 1.0;
    for (int k = 0; k < 3; k++) {
      put_out_[k] = begin_[k] + way * (target[k] - begin_[k]);
    }
    const double speed = std::hypot(put_out_[0], put_out_[1]);
    const double share = speed > fastest_ ? fastest_ / speed : 1.0; // on the same arc
    geometry_msgs::msg::TwistStamped found;
    found.header.stamp = clock_->now();
    found.header.frame_id = costmap_->getBaseFrameID();
    found.twist.linear.x = share * put_out_[0], found.twist.linear.y = share * put_out_[1];
    found.twist.angular.z = share * put_out_[2];
    return found;
  }

  /// Begin the next ramp at a standstill.
  void stand()
  {
    std::fill(put_out_, put_out_ + 3, 0.0);
    decided_ = -INFINITY;
  }

  rclcpp::Clock::SharedPtr clock_;
  rclcpp::Logger logger_ {rclcpp::get_logger("wideberth_nav2")};
  std::shared_ptr<tf2_ros::Buffer> tf_;
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_;
  std::string kind_, topic_;
  double timeout_, radius_, deviation_, around_, tick_;
  bool walls_;

  std::mutex mutex_; // of what the subscription writes
  Received received_;
  rclcpp::SubscriptionBase::SharedPtr subscription_;

  std::vector<double> memory_;
  wideberth_planner * planner_ = nullptr;
  wideberth_decision decision_{};
  nav_msgs::msg::Path path_;
  bool new_path_ = false;
  std::vector<unsigned char> cells_, taken_;

  double decided_ = -INFINITY;                  // s, of the last decision
  double begin_[3] = {}, put_out_[3] = {};      // velocities at it, and put out last
  double fastest_ = INFINITY;                   // m/s, the speed limit
};

}  // namespace wideberth_nav2

PLUGINLIB_EXPORT_CLASS(wideberth_nav2::Controller, nav2_core::Controller)
