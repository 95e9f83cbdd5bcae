classdef gripper < trocar.measured
    % The gripper of a master: one angle, rad, valid without power as well.

    properties (Access = private)
        name
    end

    methods

        function self = gripper(bridge, name)
            % Made by trocar.mtm.
            self@trocar.measured(bridge, [name '/gripper/']);
            self.name = name;
        end

        function result = closed(self)
            % Whether the master reports it closed.
            result = trocar.internal.reported(self.joints_of, [self.name '/gripper/closed'], 'closed');
        end

    end

end
